//! Reads the triangles of a file's default scene as one mesh.
//!
//! The document may be hostile: every number is checked before use, memory is allocated only for bytes that
//! exist, and no file unpacks to more than 1024 times its size.

use super::accessor::Accessors;
use super::buffers::Buffers;
use super::container::ContainerFile;
use super::document::{self, Document, INSTANCING, MeshInstance, instances, is_readable, take_off};
use super::merge::MergedMesh;
use super::{compose, part};
use crate::finish::finish;
use crate::{ReadOptions, Source, format};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_scene::{Error, ImportedScene, Limits, Provenance, Result, Scene};

/// The triangles of the default scene as one mesh: all nodes placed, all primitives merged, colours
/// linear.
///
/// Colours are one per face when no faces share vertices and each has one colour, so that files of this
/// program read back unchanged.
///
/// # Errors
/// `Malformed` for broken containers, JSON and accessors; `Unsupported` for glTF 1.0, Draco, unknown
/// required extensions and scenes without triangles.
pub fn read(mut source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    let path = source.path.clone();
    let limits = &options.limits;
    let container = ContainerFile::read(&mut source, limits)?;
    let document: Document = document::parse(&path, &container.json, limits)
        .and_then(|document| check_support(&path, &document).map(|()| document))
        .map_err(|error| crate::foreign_json(&path, &container.json).unwrap_or(error))?;
    let mut instances = instances(&path, &document, limits)?;
    let buffers = Buffers::new(source, &container, &document.buffers, options);
    drop(container);
    let srgb = compose::has_srgb_colors(&document.asset);
    let mut merged = MergedMesh::new(&document, Accessors::new(&document, buffers), srgb, *limits);
    for node in &document.nodes {
        if node.skin.is_some() {
            merged.warn("skins are not applied");
        }
        if node.extensions.contains_key(INSTANCING) {
            merged.warn(format!("{INSTANCING} is not read: its meshes are drawn once"));
        }
    }
    let origin = merged.reserve(&instances)?;
    take_off(&mut instances, origin);
    // The backdrop comes last, even if another program has moved it.
    let is_backdrop =
        |i: &&MeshInstance| document.nodes[i.node].name.as_deref().is_some_and(part::is_backdrop);
    for instance in instances.iter().filter(|i| !is_backdrop(i)) {
        merged.add(instance)?;
    }
    let scene_faces = merged.faces;
    for instance in instances.iter().filter(is_backdrop) {
        merged.add(instance)?;
    }
    let backdrop = (merged.faces - scene_faces) as u32;
    if merged.faces == 0 && document.extensions_used.iter().any(|name| name == format::GLTF_EXTENSION) {
        return Err(format::refusal(&path, "glTF"));
    }
    let (mesh, warnings) = merged.finish()?;
    let provenance = Provenance { backdrop, ..compose::provenance(&document.asset) };
    let loaded = ImportedScene { scene: Scene::Mesh(mesh), provenance, warnings, cameras: Vec::new() };
    finish(&path, loaded, origin)
}

pub(crate) fn check_support(path: &Path, document: &Document) -> Result<()> {
    if !document.asset.version.starts_with("2.") {
        return Err(Error::unsupported(
            path,
            format!("is glTF {:?}; convert it to glTF 2.0", document.asset.version),
        ));
    }
    let unknown = document.extensions_required.iter().find(|name| !is_readable(name));
    match unknown {
        Some(name) if name.starts_with(format::GLTF_EXTENSION) => Err(format::refusal(path, "glTF")),
        Some(name) => {
            Err(Error::unsupported(path, format!("requires the extension {name}; export it again without")))
        }
        None => Ok(()),
    }
}

// ---- What a document counts and asks for -------------------------------------------------------------

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
pub(crate) fn gltf_info(mut source: Source, limits: &Limits) -> Result<GltfInfo> {
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
