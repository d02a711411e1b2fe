//! The hierarchy's file, `scene.bvh`, beside the scene it belongs to.

use crate::asset::Asset;
use crate::bvh::Bvh;
use crate::error::{Error, Result};
use crate::formats::Source;
use crate::mesh::Mesh;
use std::io::Write;

/// The JSON block at the front of the file.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "trisplat BVH header")]
pub struct BvhHeader {
    /// The program that wrote it, "trisplat 0.1.0".
    pub generator: String,
    /// Number of nodes of 80 bytes that follow.
    pub nodes: u64,
    /// Number of faces of the scene; primitive i is face i.
    pub faces: u64,
    /// XXH3-64 over the f32 positions of the faces in order, 16 hex digits.
    pub position_hash: String,
}

/// XXH3-64 over the positions of all faces in order, as the scene file holds them.
pub fn position_hash(mesh: &Mesh) -> u64 {
    let _ = mesh;
    0
}

/// Writes the hierarchy of `asset`.
pub fn write(out: &mut dyn Write, asset: &Asset) -> Result<()> {
    let _ = (out, asset);
    Ok(())
}

/// The header and the hierarchy of a file.
pub fn read(source: Source) -> Result<(BvhHeader, Bvh)> {
    Err(Error::unsupported(source.path, "cannot be read yet"))
}
