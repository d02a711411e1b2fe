//! Puts faces that are near in space near in the file, each within its chunk: compresses better and keeps
//! an engine's caches warm.

use glam::DVec3;
use trisplat_scene::parallel;
use trisplat_scene::{
    Asset, Chunk, Result,
    math::curve::along_curve,
    mesh::Mesh,
    report::{Outcome, StageDetails},
};

/// The order of faces within a chunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum FaceOrder {
    /// Along a space-filling curve
    Spatial,
    /// In the order of the input
    None,
}

/// The order of faces.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OrderOptions {
    /// Order of the triangles within a chunk; with a hierarchy it is always the order of its leaves
    pub order: FaceOrder,
}

impl OrderOptions {
    /// Near faces stay near.
    pub const DEFAULT: Self = Self { order: FaceOrder::Spatial };
    /// In the order of the input.
    pub const FAST: Self = Self { order: FaceOrder::None };
}

impl Default for OrderOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What ordering did.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct OrderDetails {
    /// Faces that changed their place in the file.
    pub moved: u64,
}

impl StageDetails for OrderDetails {
    const STAGE: &'static str = "order";
}

/// Orders the faces of every chunk. Runs after the hierarchy, and keeps its leaf order.
pub fn order(asset: &mut Asset, options: &OrderOptions, details: &mut OrderDetails) -> Result<Outcome<()>> {
    if asset.bvh.is_some() {
        return Ok(Outcome::Skipped("faces are in the order of the hierarchy's leaves"));
    }
    if options.order == FaceOrder::None {
        return Ok(Outcome::Skipped("it was not asked for"));
    }
    let mesh = &asset.mesh;
    let faces_of = |chunk: &Chunk| (chunk.first..chunk.first + chunk.count).collect::<Vec<_>>();
    let order = parallel::map(&asset.chunks, |_, chunk| faces_along_curve(mesh, &faces_of(chunk))).concat();
    let moved = order.iter().zip(0..).filter(|&(&from, to)| from != to).count();
    if moved == 0 {
        return Ok(Outcome::Skipped("near faces are near in the file already"));
    }
    asset.mesh.select(&order);
    details.moved = moved as u64;
    Ok(Outcome::Changed(()))
}

/// Faces along a curve through their centroids.
pub(super) fn faces_along_curve(mesh: &Mesh, faces: &[u32]) -> Vec<u32> {
    let centroid = |face: &u32| {
        let [a, b, c] = mesh.corners(*face as usize).map(|v| v.as_dvec3());
        (a + b + c) / 3.0
    };
    let centroids: Vec<DVec3> = faces.iter().map(centroid).collect();
    along_curve(&centroids).into_iter().map(|place| faces[place as usize]).collect()
}
