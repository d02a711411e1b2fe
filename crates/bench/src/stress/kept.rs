//! Errors of a case in files and bakes: positions that come back from a GLB, plain and
//! quantised; triangles that are lost, and numbers that are not finite.

use super::case::StressScene;
use glam::{DVec3, Vec3};
use std::path::Path;
use trisplat_bake::{BakeOptions, REACH, TeacherOptions, bake};
use trisplat_formats::gltf::{GltfOptions, PositionEncoding, to_glb_bytes};
use trisplat_formats::{ReadOptions, read};
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Asset, Error, ImportedScene, Result, Scene};

/// Steps along an axis of a quantised chunk.
const STEPS: f64 = u16::MAX as f64;

/// Largest error of a position that was written to the GLB `path` and read, in half steps of its
/// format: 16 bits over the extent of the mesh along each axis, and the half of a last place of
/// single precision that a reader rounds by. Infinite when triangles are missing.
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
    let extent =
        all().fold(DVec3::NEG_INFINITY, DVec3::max) - all().fold(DVec3::INFINITY, DVec3::min);
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

/// Cases of more triangles are not compared: each is looked for among all.
const MAX_FACES: usize = 256;
/// A triangle is there when its corners are as near as this, in last places of the largest
/// coordinate: it was moved to an origin and back.
const LAST_PLACES: f64 = 4.0;
/// Height over longest edge below which a triangle is a line, in last places of its coordinates.
const FLAT: f64 = 8.0;

/// Triangles of the case, made opaque, that a bake with the default options loses or moves. A scene
/// that is refused loses none.
pub(super) fn lost(scene: &StressScene) -> f64 {
    let (mesh, _) = scene.solid();
    let there: Vec<[Vec3; 3]> =
        (0..mesh.face_count()).map(|face| mesh.corners(face)).filter(can_be_drawn).collect();
    if there.is_empty() || mesh.face_count() > MAX_FACES {
        return 0.0;
    }
    let reaches = mesh.positions.iter().all(|p| p.abs().max_element() <= REACH);
    let Ok(asset) = bake(ImportedScene::from(Scene::Mesh(mesh)), &BakeOptions::default()) else {
        return if reaches { there.len() as f64 } else { 0.0 };
    };
    let placement = asset.provenance.placement;
    let faces: Vec<[DVec3; 3]> = (0..asset.mesh.face_count())
        .map(|face| asset.mesh.corners(face).map(|corner| placement.to_world_f64(corner)))
        .collect();
    there.iter().filter(|corners| !faces.iter().any(|face| is_same(corners, face))).count() as f64
}

/// Numbers that are not finite in a bake of the soft case, without pictures of it.
pub(super) fn non_finite(scene: &StressScene) -> f64 {
    let options = BakeOptions { teacher: TeacherOptions::OFF, ..BakeOptions::default() };
    // A bake refuses a scene without anything to draw.
    let Ok(asset) = bake(ImportedScene::from(scene.soup.clone()), &options) else { return 0.0 };
    let Mesh { positions, .. } = &asset.mesh;
    let colors =
        (0..asset.mesh.face_count()).flat_map(|face| asset.mesh.corner_colors(face)).flatten();
    let numbers = positions.iter().flat_map(|p| p.to_array()).chain(colors);
    numbers.filter(|number| !number.is_finite()).count() as f64
}

/// True for a triangle within reach that has an area.
fn can_be_drawn(corners: &[Vec3; 3]) -> bool {
    let [a, b, c] = corners.map(|corner| corner.as_dvec3());
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let height = (b - a).cross(c - a).length() / longest;
    let reach = corners.iter().map(|corner| corner.abs().max_element()).fold(0.0, f32::max);
    reach <= REACH && height > FLAT * f64::from(f32::EPSILON) * longest.max(f64::from(reach))
}

fn is_same(corners: &[Vec3; 3], face: &[DVec3; 3]) -> bool {
    let reach = corners.iter().map(|corner| corner.abs().max_element()).fold(0.0, f32::max);
    let near = LAST_PLACES * f64::from(f32::EPSILON * reach);
    let is_near = |a: &Vec3, b: &DVec3| (a.as_dvec3() - *b).abs().max_element() <= near;
    (0..3).any(|turn| (0..3).all(|k| is_near(&corners[k], &face[(k + turn) % 3])))
}

#[cfg(test)]
mod tests {
    use super::super::axes::Axis;
    use super::super::case::StressCase;
    use super::*;
    use std::collections::BTreeMap;

    /// Case of seed 8 among a million: on one axis all positions are the same number, whose
    /// shortest text is not exact.
    #[test]
    fn positions_three_million_units_away_come_back() {
        let axes =
            [(Axis::Distance, 3_280_510.373_693_166_3), (Axis::Gap, 0.000_383_851_302_724_01)];
        let case = StressCase { seed: 3_221_861_613_712_043, axes: axes.into_iter().collect() };
        let (mesh, _) = StressScene::new(&case).solid();
        let folder = tempfile::tempdir().unwrap();
        for encoding in [PositionEncoding::F32, PositionEncoding::ChunkU16] {
            let path = folder.path().join("case.glb");
            let found = half_steps(&mesh, encoding, &path).unwrap();
            assert!(found <= 1.0, "{encoding:?}: {found}");
        }
    }

    #[test]
    fn decimation_finds_a_triangle_by_any_first_corner() {
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let turned = [Vec3::X, Vec3::Y, Vec3::ZERO].map(|corner| corner.as_dvec3());
        assert!(can_be_drawn(&corners) && is_same(&corners, &turned));
        let [a, b, c] = turned;
        assert!(
            !is_same(&corners, &[a, b, c + DVec3::splat(1e-5)]) && !is_same(&corners, &[b, a, c])
        );
        assert!(!can_be_drawn(&[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X]));
        assert!(!can_be_drawn(&corners.map(|corner| 2e15 * corner)));
    }

    #[test]
    fn an_ordinary_case_is_kept_whole() {
        let scene = StressScene::new(&StressCase { seed: 1, axes: BTreeMap::new() });
        assert!(scene.soup.vertices.iter().any(can_be_drawn));
        assert_eq!((lost(&scene), non_finite(&scene)), (0.0, 0.0));
    }
}
