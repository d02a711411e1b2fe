//! From a pixel and the depth there to the place in another camera's picture.
//!
//! ```text
//! p = A (x, y, 1) + b / z        place = p.xy / p.z        depth there = p.z · z
//! ```

use super::plane::Plane;
use crate::camera::Camera;
use glam::{DMat3, DVec3, Mat3, Vec2, Vec3};

/// The map of pixels from one camera to another.
#[derive(Debug, Clone, Copy)]
pub(super) struct Warp {
    infinite: Mat3,
    epipole: Vec3,
}

/// The image of a pixel's plane in another picture: homogeneous place of the pixel's centre, and its change
/// per pixel to the right and down.
#[derive(Debug, Clone, Copy)]
pub(super) struct Homography {
    pub(super) middle: Vec3,
    pub(super) right: Vec3,
    pub(super) down: Vec3,
}

impl Warp {
    /// Between the pictures of two cameras.
    pub(super) fn new(from: &Camera, to: &Camera) -> Self {
        let rotation = to.rotation.as_dmat3() * from.rotation.as_dmat3().transpose();
        let translation = to.translation.as_dvec3() - rotation * from.translation.as_dvec3();
        let matrix = intrinsics(to);
        Self {
            infinite: (matrix * rotation * intrinsics(from).inverse()).as_mat3(),
            epipole: (matrix * translation).as_vec3(),
        }
    }

    /// The homogeneous place of a point on the ray of `place`, px, at 1/depth `inverse`.
    #[inline(always)]
    pub(super) fn place(&self, place: Vec2, inverse: f32) -> Vec3 {
        self.infinite.x_axis * place.x
            + self.infinite.y_axis * place.y
            + self.infinite.z_axis
            + self.epipole * inverse
    }

    /// The picture of a plane around the pixel whose centre is at `place`.
    #[inline(always)]
    pub(super) fn homography(&self, place: Vec2, plane: Plane) -> Homography {
        Homography {
            middle: self.place(place, plane.inverse),
            right: self.infinite.x_axis + self.epipole * plane.slope.x,
            down: self.infinite.y_axis + self.epipole * plane.slope.y,
        }
    }
}

fn intrinsics(camera: &Camera) -> DMat3 {
    let (focal, center) = (camera.focal.as_dvec2(), camera.center.as_dvec2());
    DMat3::from_cols(DVec3::X * focal.x, DVec3::Y * focal.y, center.extend(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec2;

    #[test]
    fn a_point_is_found_where_the_other_camera_sees_it() {
        let lens = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::new(80.0, 82.0),
            center: Vec2::new(33.0, 22.0),
            size: UVec2::new(64, 48),
        };
        let target = Vec3::new(0.2, 0.1, 3.0);
        let from = lens.looking(Vec3::new(0.1, 0.0, 0.0), target, Vec3::NEG_Y);
        let to = lens.looking(Vec3::new(0.9, 0.2, 0.3), target, Vec3::NEG_Y);
        let point = Vec3::new(0.4, -0.2, 2.7);
        let see = |camera: &Camera| {
            let v = camera.rotation * point + camera.translation;
            (v.truncate() / v.z * camera.focal + camera.center, v.z)
        };
        let ((here, z), (there, far)) = (see(&from), see(&to));
        let p = Warp::new(&from, &to).place(here, 1.0 / z);
        assert!((p.truncate() / p.z - there).length() < 1e-3, "{p} {there}");
        assert!((p.z * z - far).abs() < 1e-4);
    }
}
