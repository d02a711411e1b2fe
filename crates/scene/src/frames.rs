//! Coordinate frames of cameras: the world of photos, and that of a file with a placed scene.

use crate::asset::Placement;
use crate::camera::Camera;
use glam::DVec3;

/// A camera of a world whose coordinates are relative to `origin`, in the frame of a file placed by
/// `placement`. Depths are in the file's units.
///
/// ```text
/// q = R (w - origin) + t,   f = U s (w - center)   gives   s q = R U^T f + s (R (center - origin) + t)
/// ```
pub fn to_file(camera: &Camera, placement: &Placement, origin: DVec3) -> Camera {
    let rotation = camera.rotation.as_dmat3();
    let moved = rotation * (DVec3::from(placement.center) - origin) + camera.translation.as_dvec3();
    Camera {
        rotation: (rotation * placement.rotation().transpose()).as_mat3(),
        translation: (moved * placement.scale).as_vec3(),
        ..*camera
    }
}

/// Undoes [`to_file`].
pub fn to_world(camera: &Camera, placement: &Placement, origin: DVec3) -> Camera {
    let rotation = camera.rotation.as_dmat3() * placement.rotation();
    let moved = camera.translation.as_dvec3() / placement.scale;
    Camera {
        rotation: rotation.as_mat3(),
        translation: (moved - rotation * (DVec3::from(placement.center) - origin)).as_vec3(),
        ..*camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::asset::UpAxis;
    use glam::{Mat3, UVec2, Vec2, Vec3};

    #[test]
    fn a_placed_camera_sees_placed_points_where_it_saw_them() {
        let camera = Camera {
            rotation: Mat3::from_rotation_x(0.4) * Mat3::from_rotation_z(1.1),
            translation: Vec3::new(0.3, -2.0, 4.0),
            focal: Vec2::new(400.0, 410.0),
            center: Vec2::new(330.0, 220.0),
            size: UVec2::new(640, 480),
        };
        let origin = DVec3::new(1000.0, -50.0, 3.0);
        let pixel = |c: &Camera, p: Vec3| {
            let q = c.rotation * p + c.translation;
            (q.truncate() / q.z * c.focal + c.center, q.z)
        };
        for up in [UpAxis::Y, UpAxis::NegY, UpAxis::Z, UpAxis::NegZ, UpAxis::X, UpAxis::NegX] {
            let placement =
                Placement { up: up.into(), rotate: 33.0, scale: 2.5, center: [999.0, -49.0, 5.0] };
            let placed = to_file(&camera, &placement, origin);
            assert!((placed.rotation.determinant() - 1.0).abs() < 1e-5);
            for point in [Vec3::new(0.5, 1.0, 2.0), Vec3::new(-1.0, 0.25, 0.0)] {
                let world = (point.as_dvec3() + origin).as_vec3();
                let wants = pixel(&camera, point);
                let got = pixel(&placed, placement.to_file(world));
                assert!(
                    wants.0.distance(got.0) < 0.1 && (got.1 / wants.1 - 2.5).abs() < 1e-3,
                    "{up:?}"
                );
            }
            let back = to_world(&placed, &placement, origin);
            assert!(back.rotation.abs_diff_eq(camera.rotation, 1e-5));
            assert!(back.translation.abs_diff_eq(camera.translation, 1e-3));
        }
    }
}
