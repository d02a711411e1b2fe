//! The levels of a scene for an engine, and the distance at which each suffices.
//!
//! A level suffices from the distance at which its median triangle is 2 px wide on a screen 1080 px high, as
//! in a tileset. Engines measure distances from the middle of a scene, so the radius is added for its nearest
//! triangles.

use crate::tileset;
use glam::DVec3;
use trisplat_scene::Asset;

/// Height of the screen that levels are chosen for, px.
const SCREEN_PX: f64 = 1080.0;
/// Width of a level's median triangle on that screen at which a finer level takes over, px.
const TRIANGLE_PX: f64 = 2.0;
/// Least ratio of the distances at which two levels change: engines need falling heights on the screen.
pub(super) const APART: f64 = 1.001;

/// A level and its file.
#[derive(Debug)]
pub(crate) struct LevelFile {
    /// Name of the file.
    pub(crate) name: String,
    /// Names of its nodes, without the backdrop's.
    pub(crate) nodes: Vec<String>,
    /// Names of the backdrop's nodes; usually one, or none.
    pub(crate) backdrop: Vec<String>,
}

/// The scene and its levels, finest first, and the space they are in.
#[derive(Debug)]
pub(crate) struct EngineScene {
    pub(super) files: Vec<LevelFile>,
    /// Side of the median triangle of each level, units of the file.
    pub(super) details: Vec<f64>,
    /// Lowest and highest corner of all levels.
    pub(super) bounds: [DVec3; 2],
    /// Radius of the sphere about the middle of the bounds that contains all levels.
    pub(super) radius: f64,
}

impl EngineScene {
    /// From the finest level and the others, and their files, in this order.
    pub(crate) fn new<'a>(levels: impl Iterator<Item = (&'a Asset, LevelFile)>) -> Self {
        let (assets, files): (Vec<&Asset>, Vec<LevelFile>) = levels.unzip();
        let bounds = assets.iter().filter_map(|asset| tileset::bounds(&asset.mesh, asset.scene_faces()));
        let bounds = bounds.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)]).unwrap_or_default();
        let middle = (bounds[0] + bounds[1]) / 2.0;
        let corners =
            assets.iter().flat_map(|asset| (0..asset.scene_faces()).flat_map(|f| asset.mesh.corners(f)));
        let radius = corners.map(|p| p.as_dvec3().distance(middle)).fold(0.0, f64::max);
        let details = assets.iter().map(|asset| asset.detail()).collect();
        Self { files, details, bounds, radius }
    }

    /// The distance from the middle at which each level but the finest begins, for a camera with this tangent
    /// of half its vertical angle.
    pub(super) fn distances(&self, tangent: f64) -> Vec<f64> {
        let near = |detail: &f64| detail / TRIANGLE_PX * SCREEN_PX / (2.0 * tangent);
        let mut last = 0.0_f64;
        let mut next = |distance: f64| {
            last = distance.max(last * APART);
            last
        };
        self.details.iter().skip(1).map(|detail| next(near(detail) + self.radius)).collect()
    }
}

/// Three levels of a cube about (1, 2, 3) whose corners are 3 units from there.
#[cfg(test)]
pub(super) fn cube() -> EngineScene {
    let half = DVec3::splat(3f64.sqrt());
    let middle = DVec3::new(1.0, 2.0, 3.0);
    let file = |(name, nodes): (&str, &[&str])| LevelFile {
        name: name.into(),
        nodes: nodes.iter().map(|node| (*node).into()).collect(),
        backdrop: vec!["backdrop".into()],
    };
    let files = [
        ("a.glb", &["chunk_0000", "chunk_0001"][..]),
        ("a.lod1.glb", &["scene"]),
        ("a.lod2.glb", &["scene"]),
    ];
    EngineScene {
        files: files.map(file).into(),
        details: vec![0.01, 0.02, 0.04],
        bounds: [middle - half, middle + half],
        radius: 3.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_level_is_drawn_from_where_its_triangles_are_two_pixels_wide() {
        let tangent = 0.5;
        let distances = cube().distances(tangent);
        for (distance, detail) in distances.iter().zip([0.02, 0.04]) {
            let nearest = distance - 3.0;
            let px = detail / nearest * SCREEN_PX / (2.0 * tangent);
            assert!((px - 2.0).abs() < 1e-9, "{px} px at {distance}");
        }
        let still = EngineScene { details: vec![1.0, 1.0, 1.0], ..cube() }.distances(tangent);
        assert!(still[0] < still[1], "{still:?}");
    }
}
