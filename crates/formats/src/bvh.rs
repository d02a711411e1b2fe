//! The hierarchy's file, `scene.bvh`, beside the scene it belongs to.
//!
//! ```text
//! offset  bytes
//! 0       4      "TBVH"
//! 4       4      version, u32: 1
//! 8       4      length of the JSON block, u32, a multiple of 16
//! 12      4      0
//! 16      ..     JSON, padded with spaces: BvhHeader
//! ..      80 * n nodes
//! ```
//!
//! Little-endian. A node is 80 bytes: `f32 p[3]; u8 e[3]; u8 imask; u32 child_base; u32 face_base; u8 meta[8];`
//! then per child `u8 min_x[8], max_x[8], min_y[8], max_y[8], min_z[8], max_z[8]`. The box of child i spans
//! `p + 2^(e - 127) * min[i]` to `p + 2^(e - 127) * max[i]`. `Bvh::cast` reads it.

use crate::Source;
use obvhs::cwbvh::node::CwBvhNode;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io::{Read, Write};
use std::path::Path;
use trisplat_scene::{Asset, Chunk, Error, Placement, Result, bvh::Bvh, mesh::Mesh, report::generator};
use xxhash_rust::xxh3::Xxh3Default;

const MAGIC: [u8; 4] = *b"TBVH";
const VERSION: u32 = 1;
const PREFIX_BYTES: usize = 16;
const NODE_BYTES: usize = size_of::<CwBvhNode>();

/// The JSON block at the front of the file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "trisplat BVH header")]
pub struct BvhHeader {
    /// The program that wrote it, "trisplat 0.1.0".
    pub generator: String,
    /// Number of nodes of 80 bytes that follow; node 0 is the root, children come after their parents.
    pub nodes: u32,
    /// Number of faces of the scene without its backdrop; primitive i is face i, counted through its chunks.
    pub faces: u32,
    /// Runs of faces that are separate meshes in the scene file, and the node of each.
    pub chunks: Vec<BvhChunk>,
    /// XXH3-64 over the positions of all faces in order, three corners of three little-endian f32 each,
    /// before quantisation: 16 hex digits.
    #[schemars(regex(pattern = "^[0-9a-f]{16}$"))]
    pub position_hash: String,
    /// The map from the trained world to the scene file. Boxes have the file's coordinates.
    pub placement: Placement,
}

/// A chunk of the scene, in the hierarchy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct BvhChunk {
    /// First face.
    pub first: u32,
    /// Number of faces.
    pub count: u32,
    /// The node with exactly these faces.
    pub node: u32,
}

/// XXH3-64 over the positions of the first `faces` in order, three corners of three little-endian f32 each.
pub fn position_hash(mesh: &Mesh, faces: usize) -> u64 {
    let mut hash = Xxh3Default::new();
    if mesh.indices.is_empty() {
        hash.update(bytemuck::cast_slice(&mesh.positions[..3 * faces]));
    } else {
        for face in 0..faces {
            hash.update(bytemuck::cast_slice(&mesh.corners(face)));
        }
    }
    hash.digest()
}

/// Writes the hierarchy of `asset`, which has one.
pub fn write(out: &mut dyn Write, asset: &Asset) -> std::io::Result<()> {
    let Some(bvh) = &asset.bvh else {
        return Err(std::io::Error::other("the scene has no hierarchy to write"));
    };
    let chunk = |(chunk, &node): (&Chunk, &u32)| BvhChunk { first: chunk.first, count: chunk.count, node };
    let header = BvhHeader {
        generator: generator(),
        nodes: bvh.nodes.len() as u32,
        faces: bvh.face_count,
        chunks: asset.chunks.iter().zip(&bvh.roots).map(chunk).collect(),
        position_hash: format!("{:016x}", position_hash(&asset.mesh, asset.scene_faces())),
        placement: asset.provenance.placement,
    };
    let mut json = serde_json::to_vec(&header)?;
    json.resize(json.len().next_multiple_of(PREFIX_BYTES), b' ');
    out.write_all(&MAGIC)?;
    for word in [VERSION, json.len() as u32, 0] {
        out.write_all(&word.to_le_bytes())?;
    }
    out.write_all(&json)?;
    out.write_all(bytemuck::cast_slice(&bvh.nodes))
}

/// The header and the hierarchy of a file, checked in itself; [`belongs`] checks it against its scene.
pub fn read(mut source: Source) -> Result<(BvhHeader, Bvh)> {
    let path = source.path.clone();
    let broken = |at: &str, reason: String| Error::malformed(&path, at, reason);
    let mut prefix = [[0; 4]; 4];
    fill(&mut source, bytemuck::cast_slice_mut(&mut prefix), "prefix")?;
    if prefix[0] != MAGIC {
        return Err(broken("byte 0", "does not start with \"TBVH\": not a trisplat hierarchy".into()));
    }
    let [version, json_bytes, _] = [prefix[1], prefix[2], prefix[3]].map(u32::from_le_bytes);
    if version != VERSION {
        let reason = format!("is version {version}, this program reads {VERSION}: bake the scene again");
        return Err(Error::unsupported(&path, reason));
    }
    let rest = source.len.saturating_sub(PREFIX_BYTES as u64);
    if u64::from(json_bytes) > rest {
        return Err(broken("byte 8", format!("promises {json_bytes} bytes of JSON, {rest} are left")));
    }
    let mut json = vec![0; json_bytes as usize];
    fill(&mut source, &mut json, "JSON block")?;
    let header: BvhHeader = serde_json::from_slice(&json)
        .map_err(|e| broken("JSON block", format!("{e}; bake the scene again")))?;
    let (promised, left) = (u64::from(header.nodes) * NODE_BYTES as u64, rest - u64::from(json_bytes));
    if promised != left {
        return Err(broken("nodes", format!("expected {promised} bytes, the file has {left}")));
    }
    let mut nodes = vec![CwBvhNode::default(); header.nodes as usize];
    fill(&mut source, bytemuck::cast_slice_mut(&mut nodes), "nodes")?;
    let roots = header.chunks.iter().map(|chunk| chunk.node).collect();
    let bvh = Bvh { nodes, roots, face_count: header.faces };
    bvh.validate().map_err(|e| broken("nodes", e.to_string()))?;
    check_chunks(&header, &bvh).map_err(|reason| broken("chunks", reason))?;
    Ok((header, bvh))
}

/// Checks by the hash of the positions that a hierarchy belongs to `mesh`, a scene without its backdrop.
pub fn belongs(path: &Path, header: &BvhHeader, mesh: &Mesh) -> Result<()> {
    let hash = format!("{:016x}", position_hash(mesh, mesh.face_count()));
    if header.faces as usize != mesh.face_count() || header.position_hash != hash {
        let reason = format!(
            "belongs to another scene ({} faces, hash {}, the scene has {} and {hash}); bake again with `bvh`",
            header.faces,
            header.position_hash,
            mesh.face_count()
        );
        return Err(Error::unsupported(path, reason));
    }
    Ok(())
}

/// Chunks must be consecutive and hold every face once, and each must agree with its node.
fn check_chunks(header: &BvhHeader, bvh: &Bvh) -> std::result::Result<(), String> {
    let ranges = bvh.face_ranges().map_err(|e| e.to_string())?;
    let mut next = 0;
    for chunk in &header.chunks {
        let end = chunk.first.checked_add(chunk.count);
        if chunk.first != next || end.is_none_or(|end| ranges[chunk.node as usize] != (next..end)) {
            return Err(format!("{chunk:?} is not what its node holds from face {next}"));
        }
        next = end.unwrap_or(next);
    }
    if next == header.faces { Ok(()) } else { Err(format!("hold {next} faces of {}", header.faces)) }
}

fn fill(source: &mut Source, bytes: &mut [u8], what: &str) -> Result<()> {
    (&*source.file).read_exact(bytes).map_err(|e| match e.kind() {
        std::io::ErrorKind::UnexpectedEof => {
            Error::malformed(&source.path, what, "the file ends in the middle of it")
        }
        _ => Error::io(&source.path, e),
    })
}
