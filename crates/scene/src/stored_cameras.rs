//! Cameras of photos as a file stores them, in its provenance: a few, in eight numbers each.

use crate::camera::Camera;
use crate::limits::Limits;
use crate::math::lists::evenly_spaced;
use glam::{DMat3, DQuat, DVec2, DVec3};

/// Maximum number of stored cameras; each takes about 60 bytes.
const MAX_CAMERAS: usize = 32;
/// Pixels of the picture of a decoded camera; its aspect ratio is stored.
const PIXELS: f64 = 230_000.0;
/// Steps per unit of a stored number: positions are rounded to 1/10,000 of the cameras' extent (its
/// power of ten), rotations and tangents to 1/10,000.
const STEPS_PER_UNIT: f64 = 1e4;

/// Encode an even selection of `cameras` for [`Provenance::cameras`](crate::Provenance::cameras).
pub fn encode_cameras(cameras: &[Camera]) -> Vec<[f64; 8]> {
    let chosen: Vec<Camera> =
        evenly_spaced(cameras.len(), MAX_CAMERAS).map(|i| cameras[i]).collect();
    let distances = chosen.iter().map(|c| c.position().distance(chosen[0].position()));
    let extent = f64::from(distances.fold(0.0, f32::max));
    let unit = libm::pow(10.0, libm::floor(libm::log10(extent.max(1e-9))));
    chosen.iter().map(|camera| encode(camera, unit)).collect()
}

/// Encode one camera: position, rotation as x, y, z of modified Rodrigues parameters, and the
/// tangents of half the fields of view. Positions are rounded relative to `unit`.
fn encode(camera: &Camera, unit: f64) -> [f64; 8] {
    let rounded = |number: f64, steps: f64| (number * steps).round() / steps;
    let rotation = DQuat::from_mat3(&camera.rotation.as_dmat3().transpose());
    let rotation = if rotation.w < 0.0 { -rotation } else { rotation };
    let tangent = (camera.size.as_vec2() / camera.focal / 2.0).as_dvec2();
    let [px, py, pz] =
        camera.position().as_dvec3().to_array().map(|x| rounded(x, STEPS_PER_UNIT / unit));
    let [x, y, z] = (rotation.xyz() / (1.0 + rotation.w)).to_array();
    let [x, y, z, wide, high] = [x, y, z, tangent.x, tangent.y].map(|x| rounded(x, STEPS_PER_UNIT));
    [px, py, pz, x, y, z, wide, high]
}

/// Decode cameras of [`Provenance::cameras`](crate::Provenance::cameras); impossible ones are left
/// out.
pub fn decode_cameras(stored: &[[f64; 8]]) -> Vec<Camera> {
    stored.iter().take(MAX_CAMERAS).filter_map(decode).collect()
}

/// Decode one camera; `None` when its numbers make no valid camera.
fn decode(&[px, py, pz, x, y, z, wide, high]: &[f64; 8]) -> Option<Camera> {
    let position = DVec3::new(px, py, pz).as_vec3();
    let square = x * x + y * y + z * z;
    let turn = DQuat::from_xyzw(2.0 * x, 2.0 * y, 2.0 * z, 1.0 - square).normalize();
    let tangent = DVec2::new(wide, high);
    let size = (tangent * (PIXELS / (wide * high)).sqrt()).round();
    let rotation = DMat3::from_quat(turn).transpose().as_mat3();
    let camera = Camera {
        rotation,
        translation: -(rotation * position),
        focal: (size / tangent / 2.0).as_vec2(),
        center: (size / 2.0).as_vec2(),
        size: size.as_uvec2(),
    };
    camera.validate(&Limits::DEFAULT).is_ok().then_some(camera)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2, Vec3};

    #[test]
    fn decoded_cameras_see_the_points_of_the_photos() {
        let size = UVec2::new(640, 480);
        let focal = Vec2::new(400.0, 410.0);
        let center = size.as_vec2() / 2.0;
        let lens =
            Camera { rotation: Mat3::IDENTITY, translation: Vec3::ZERO, focal, center, size };
        let eye =
            |i: usize| Vec3::new(3.0 * (i as f32).cos(), 0.2 * i as f32, 3.0 * (i as f32).sin());
        for scale in [1.0, 3e4, 2e-3] {
            let camera = |i| {
                lens.with_look_at(scale * eye(i), Vec3::ZERO, Vec3::new(0.1 * i as f32, 1.0, 0.0))
            };
            let cameras: Vec<Camera> = (0..40).map(camera).collect();
            let mut stored = encode_cameras(&cameras);
            let back = decode_cameras(&stored);
            assert_eq!(back.len(), MAX_CAMERAS);
            let chosen = evenly_spaced(cameras.len(), MAX_CAMERAS);
            for (i, back) in chosen.zip(&back) {
                let camera = cameras[i];
                let point = scale * Vec3::new(0.3, -0.4, 0.2);
                let projected = |camera: &Camera| {
                    camera.project(point).expect("in view").0 / camera.size.as_vec2()
                };
                let off = projected(&camera).distance(projected(back));
                assert!(off < 2e-3, "{scale} {i} {off}");
            }
            // Numbers of a damaged file.
            stored[0][3] = 7.0;
            stored[1][7] = 0.0;
            stored[2][0] = 1e300;
            assert_eq!(decode_cameras(&stored).len(), MAX_CAMERAS - 2);
        }
        assert!(encode_cameras(&[]).is_empty());
    }
}
