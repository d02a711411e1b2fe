//! View-dependent colours where no photo stood: how far they go from the plain ones.

use glam::{Mat3, UVec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::Dataset;
use trisplat_raster::solid::{NO_FACE, SolidRasterOptions, SolidRasterizer, view_colors};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::math::lists::{evenly_spaced, median};
use trisplat_scene::mesh::{Colors, Mesh};

/// Turn of a view beside its camera, radians: 60°, beyond what neighbouring photos show.
const TURN: f32 = std::f32::consts::FRAC_PI_3;
/// Training cameras that views lie beside, to their left and right.
const CAMERAS: usize = 12;
/// Width of the pixels of such a view, px of the photo.
const STEP: u32 = 6;

/// Change of colours by the direction, in views that look at the same from 60° beside the training
/// cameras: of the channel of a triangle that changes most, sRGB-encoded, from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShineScores {
    /// Median over the pixels.
    pub typical: f64,
    /// Maximum over the triangles that are seen.
    pub largest: f64,
}

/// The change of the colours of `mesh`, in the data set's frame; `None` without spherical
/// harmonics, or where nothing is seen.
pub(super) fn shine(mesh: &Mesh, near: f32, dataset: &Dataset) -> Option<ShineScores> {
    mesh.sh.as_ref()?;
    let cameras: Vec<Camera> = dataset.train().map(|view| view.camera).collect();
    let options = SolidRasterOptions { near, ..SolidRasterOptions::default() };
    let mut solid = SolidRasterizer::new();
    let mut changes = Vec::new();
    for camera in evenly_spaced(cameras.len(), CAMERAS).map(|i| &cameras[i]) {
        let camera = camera.resized((camera.size / STEP).max(UVec2::ONE));
        let depths = &solid.visibility(mesh, &camera, &options).depth;
        let depths = depths.iter().copied().filter(|depth| depth.is_finite()).collect();
        let Some(depth) = median(depths, f32::total_cmp) else { continue };
        for turn in [-TURN, TURN] {
            let beside = turned(&camera, depth, turn);
            let changed = face_changes(mesh, beside.position())?;
            let seen = &solid.visibility(mesh, &beside, &options).face;
            let seen = seen.iter().filter(|face| **face != NO_FACE);
            changes.extend(seen.map(|face| changed[*face as usize]));
        }
    }
    let largest = f64::from(changes.iter().copied().reduce(f32::max)?);
    Some(ShineScores { typical: f64::from(median(changes, f32::total_cmp)?), largest })
}

/// The camera, turned about its vertical through the point at `depth` that it looks at.
fn turned(camera: &Camera, depth: f32, turn: f32) -> Camera {
    let middle = Vec3::Z * depth;
    let turn = Mat3::from_rotation_y(turn);
    Camera {
        rotation: turn * camera.rotation,
        translation: turn * (camera.translation - middle) + middle,
        ..*camera
    }
}

/// The largest change of each face's colours, as seen from `eye`. `[F]`
fn face_changes(mesh: &Mesh, eye: Vec3) -> Option<Vec<f32>> {
    let Colors::Vertex(seen) = view_colors(mesh, eye)? else { return None };
    let of_face = |(face, seen): (usize, &[[f32; 3]])| {
        let plain = mesh.corner_colors(face);
        let channels = seen.as_flattened().iter().zip(plain.as_flattened());
        let change = |(seen, plain): (&f32, &f32)| {
            (srgb_from_linear(*seen) - srgb_from_linear(*plain)).abs()
        };
        channels.map(change).fold(0.0, f32::max)
    };
    Some(seen.chunks(3).enumerate().map(of_face).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_dataset::DatasetOptions;
    use trisplat_scene::FaceSh;
    use trisplat_synthetic::SyntheticOptions;

    #[test]
    fn shine_beside_the_cameras_is_the_change_of_the_harmonics() {
        let folder = tempfile::tempdir().unwrap();
        let photos =
            SyntheticOptions { views: 4, width: 48, points: 50, ..SyntheticOptions::default() };
        trisplat_synthetic::write(folder.path(), &photos).unwrap();
        let mut dataset = Dataset::load(folder.path(), &DatasetOptions::default()).unwrap();
        dataset.views.retain(|view| !view.test);
        dataset.views.truncate(1);
        let camera = dataset.views[0].camera;
        let back = camera.rotation.transpose();
        let corner = |x: f32, y: f32| back * (Vec3::new(x, y, 2.0) - camera.translation);
        let wall = [[corner(-3.0, -3.0), corner(9.0, -3.0), corner(-3.0, 9.0)]];
        let mut mesh = Mesh::from_triangles(&wall, &[[0.2; 3]]).unwrap();
        assert_eq!(shine(&mesh, 0.01, &dataset), None, "plain colours");
        // The same from everywhere: a quarter of a code of 1 more in green.
        let all = vec![[0.0, 0.25 / 0.282_094_8, 0.0], [0.0; 3], [0.0; 3], [0.0; 3]];
        mesh.sh = Some(FaceSh::new(1, all).unwrap());
        let found = shine(&mesh, 0.01, &dataset).unwrap();
        assert!((found.largest - 0.25).abs() < 1e-3, "{found:?}");
        assert_eq!(found.typical, found.largest);
        // Brightest along the wall's normal, which no corner is seen along from there.
        let normal = back * Vec3::Z;
        let of = |value: f32| [value; 3];
        let along = [-normal.y, normal.z, -normal.x].map(|part| of(0.4 * part / 0.488_602_5));
        let along = [of(0.0), along[0], along[1], along[2]];
        mesh.sh = Some(FaceSh::new(1, along.to_vec()).unwrap());
        let found = shine(&mesh, 0.01, &dataset).unwrap();
        assert!((0.05..0.2).contains(&found.typical), "{found:?}");
    }
}
