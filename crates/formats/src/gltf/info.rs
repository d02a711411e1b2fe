//! What a document counts and asks for.

use super::container::ContainerFile;
use super::document::{self, Document};
use crate::Source;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::{Limits, Result};

/// What a glTF document holds.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GltfInfo {
    /// The program that wrote it.
    pub generator: Option<String>,
    /// Extensions it uses.
    pub extensions_used: Vec<String>,
    /// Extensions a reader must know.
    pub extensions_required: Vec<String>,
    /// Number of nodes.
    pub nodes: u64,
    /// Number of meshes.
    pub meshes: u64,
    /// Number of primitives of all meshes.
    pub primitives: u64,
    /// Number of materials.
    pub materials: u64,
}

/// What the document of an open file counts and asks for.
///
/// Errors: a broken container or document; those of the operating system.
pub fn gltf_info(mut source: Source, limits: &Limits) -> Result<GltfInfo> {
    let container = ContainerFile::read(&mut source, limits)?;
    let document: Document = document::parse(&source.path, &container.json, limits)?;
    Ok(GltfInfo {
        nodes: document.nodes.len() as u64,
        meshes: document.meshes.len() as u64,
        primitives: document.meshes.iter().map(|mesh| mesh.primitives.len() as u64).sum(),
        materials: document.materials.len() as u64,
        generator: document.asset.generator,
        extensions_used: document.extensions_used,
        extensions_required: document.extensions_required,
    })
}
