//! Positions as they come back from a GLB, plain and quantised.

use glam::DVec3;
use std::path::Path;
use trisplat_formats::{
    ReadOptions,
    gltf::{GltfOptions, PositionEncoding, to_glb_bytes},
    read,
};
use trisplat_scene::{Asset, Error, Result, Scene, mesh::Mesh};

/// Steps along an axis of a quantised chunk.
const STEPS: f64 = u16::MAX as f64;

/// Largest error of a position that was written to the GLB `path` and read, in half steps of its format: 16 bits over the
/// extent of the mesh along each axis, and the half of a last place of single precision that a reader rounds by.
/// Infinite when triangles are missing.
pub(super) fn half_steps(mesh: &Mesh, encoding: PositionEncoding, path: &Path) -> Result<f64> {
    let asset = Asset { mesh: mesh.clone(), ..Asset::default() };
    let options = GltfOptions { positions: encoding, ..GltfOptions::default() };
    std::fs::write(path, to_glb_bytes(&asset, &options)?).map_err(|e| Error::io(path, e))?;
    let loaded = read(path, &ReadOptions::default())?;
    // A file far from the origin is read relative to an origin of its own.
    let placement = loaded.provenance.placement;
    let Scene::Mesh(stored) = loaded.scene else { return Ok(f64::INFINITY) };
    if stored.face_count() != mesh.face_count() {
        return Ok(f64::INFINITY);
    }
    let all = || mesh.positions.iter().map(|p| p.as_dvec3());
    let extent = all().fold(DVec3::NEG_INFINITY, DVec3::max) - all().fold(DVec3::INFINITY, DVec3::min);
    let step = match encoding {
        PositionEncoding::F32 => DVec3::ZERO,
        PositionEncoding::ChunkU16 => extent / STEPS,
    };
    let mut worst = 0.0f64;
    for face in 0..mesh.face_count() {
        for (a, b) in mesh.corners(face).into_iter().zip(stored.corners(face)) {
            let error = (a.as_dvec3() - placement.to_world_f64(b)).abs();
            for axis in 0..3 {
                // Code times scale is rounded, then the sum with the origin.
                let rounding = f64::from(f32::EPSILON) * (f64::from(a[axis]).abs() + extent[axis]);
                let half = 0.5 * step[axis] + if step[axis] > 0.0 { rounding } else { 0.0 };
                worst = worst.max(if error[axis] == 0.0 { 0.0 } else { error[axis] / half });
            }
        }
    }
    Ok(worst)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::axes::Axis;
    use crate::stress::case::StressCase;
    use crate::stress::scene::StressScene;

    /// Case of seed 8 among a million: on one axis all positions are the same number, whose shortest text is not exact.
    #[test]
    fn positions_three_million_units_away_come_back() {
        let axes = [(Axis::Distance, 3_280_510.373_693_166_3), (Axis::Gap, 0.000_383_851_302_724_01)];
        let case = StressCase { seed: 3_221_861_613_712_043, axes: axes.into_iter().collect() };
        let (mesh, _) = StressScene::new(&case).solid();
        let folder = tempfile::tempdir().unwrap();
        for encoding in [PositionEncoding::F32, PositionEncoding::ChunkU16] {
            let path = folder.path().join("case.glb");
            let found = half_steps(&mesh, encoding, &path).unwrap();
            assert!(found <= 1.0, "{encoding:?}: {found}");
        }
    }
}
