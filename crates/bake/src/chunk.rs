//! Cuts the faces into compact runs, each its own mesh and node, so that engines can cull them.
//! Cuts minimise surface area times chunks.

mod cut;

use super::order::{FaceOrder, faces_along_curve};
pub(super) use cut::cut;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::report::Outcome;
use trisplat_scene::{Asset, Chunk, Error, Result, parallel};

/// Maximum number of faces of a chunk: 65,535 vertices when no corner is shared, the most that
/// 16-bit indices can address (65,535 itself restarts a primitive).
pub const MAX_CHUNK_TRIANGLES: u32 = 21_845;

/// Options of cutting the scene into nodes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ChunkOptions {
    /// Maximum number of triangles in a chunk, at most 21845; each chunk is a mesh and node of its
    /// own, skipped when out of view (0 = one chunk)
    #[schemars(range(max = 21_845))]
    pub chunk_triangles: u32,
}

impl ChunkOptions {
    /// Small enough to be skipped often, large enough that a scene has hundreds of draws, not
    /// thousands.
    pub const DEFAULT: Self = Self { chunk_triangles: 16_384 };
    /// One chunk.
    pub const FAST: Self = Self { chunk_triangles: 0 };
}

trisplat_scene::default!(ChunkOptions);

/// The chunks of the scene.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ChunkDetails {
    /// Number of chunks.
    pub chunks: u64,
    /// Triangles per chunk on average, rounded down.
    pub mean_triangles: u64,
    /// Near triangles are near in their chunk, so `order` has nothing to do.
    #[serde(default)]
    pub ordered: bool,
}

trisplat_scene::stage!(ChunkDetails, "chunk");

/// Sets `asset.chunks` and puts the faces in their order. A scene of one chunk is left unchanged. A
/// backdrop becomes the last chunk, because its box surrounds everything and could never be culled.
/// `within` is the order of the faces of a chunk; it is made here, so that a large scene is moved
/// in memory once.
///
/// # Errors
///
/// `chunk_triangles` above [`MAX_CHUNK_TRIANGLES`].
pub fn chunk(
    asset: &mut Asset,
    options: &ChunkOptions,
    within: FaceOrder,
    details: &mut ChunkDetails,
) -> Result<Outcome<()>> {
    if options.chunk_triangles > MAX_CHUNK_TRIANGLES {
        let wants = format!("at most {MAX_CHUNK_TRIANGLES}, the most that 16-bit indices reach");
        return Err(Error::invalid("chunk_triangles", options.chunk_triangles, wants));
    }
    let faces = asset.scene_faces();
    let limit = options.chunk_triangles as usize;
    let backdrop = (faces < asset.mesh.face_count())
        .then(|| Chunk { first: faces as u32, count: (asset.mesh.face_count() - faces) as u32 });
    if asset.chunks.len() > 1 + usize::from(backdrop.is_some()) {
        return Ok(Outcome::Skipped("the scene is in chunks already"));
    }
    if limit == 0 || faces <= limit {
        asset.chunks = vec![Chunk { first: 0, count: faces as u32 }];
        asset.chunks.extend(backdrop);
        if by_material(asset) {
            details.count(asset);
            return Ok(Outcome::Changed(()));
        }
        return Ok(Outcome::Skipped(if limit == 0 {
            "one chunk was asked for"
        } else {
            "it fits one chunk"
        }));
    }
    let (mut order, chunks) = cut(&asset.mesh, faces, limit);
    if within == FaceOrder::Spatial {
        let mesh = &asset.mesh;
        let run = |chunk: &Chunk| &order[chunk.first as usize..][..chunk.count as usize];
        order = parallel::map(&chunks, |_, chunk| faces_along_curve(mesh, run(chunk))).concat();
        details.ordered = true;
    }
    order.extend(faces as u32..asset.mesh.face_count() as u32);
    asset.mesh.select(&order);
    asset.chunks = chunks;
    asset.chunks.extend(backdrop);
    by_material(asset);
    details.count(asset);
    Ok(Outcome::Changed(()))
}

impl ChunkDetails {
    /// Of the scene, without its backdrop.
    fn count(&mut self, asset: &Asset) {
        let faces = asset.scene_faces();
        let of_scene = asset.chunks.iter().filter(|chunk| (chunk.first as usize) < faces).count();
        self.chunks = of_scene as u64;
        self.mean_triangles = (faces / of_scene.max(1)) as u64;
    }
}

/// Cuts chunks so that all faces of one have the same material; within it they keep their order.
/// Returns whether it did.
pub(super) fn by_material(asset: &mut Asset) -> bool {
    let mesh = &asset.mesh;
    let has_pages = mesh.texture.as_ref().is_some_and(|texture| !texture.page_of.is_empty());
    if !has_pages && mesh.single_sided.is_empty() {
        return false;
    }
    let is_of_one = |chunk: &Chunk| {
        let first = chunk.first as usize;
        let mut faces = first..first + chunk.count as usize;
        faces.all(|face| mesh.material(face) == mesh.material(first))
    };
    if asset.chunks.iter().all(is_of_one) {
        return false;
    }
    let mut order: Vec<u32> = (0..mesh.face_count() as u32).collect();
    let mut chunks = Vec::with_capacity(asset.chunks.len());
    for chunk in &asset.chunks {
        let run = &mut order[chunk.first as usize..][..chunk.count as usize];
        run.sort_by_key(|face| mesh.material(*face as usize));
        let mut first = chunk.first;
        for part in run.chunk_by(|a, b| mesh.material(*a as usize) == mesh.material(*b as usize)) {
            chunks.push(Chunk { first, count: part.len() as u32 });
            first += part.len() as u32;
        }
    }
    asset.mesh.select(&order);
    asset.chunks = chunks;
    true
}
