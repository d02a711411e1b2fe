//! A plane at one pixel of a camera: the reciprocal of its depth is linear in the picture.
//!
//! ```text
//! 1/z(x, y) = inverse + slope · (x - x0, y - y0)        m · r = 1/z,  r = ((x - cx) / fx, (y - cy) / fy, 1),  m = -normal / distance
//! ```

use crate::camera::Camera;
use glam::{Vec2, Vec3};

/// Cosine of the largest angle between a surface's normal and the ray to the camera: 80 degrees.
const LEAST_COSINE: f32 = 0.17;

/// A plane seen from one pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Plane {
    /// 1/depth at the pixel's centre.
    pub(super) inverse: f32,
    /// Change of 1/depth per pixel to the right and down.
    pub(super) slope: Vec2,
}

impl Plane {
    /// The same plane at the pixel that is `offset` pixels away.
    #[inline(always)]
    pub(super) fn at(self, offset: Vec2) -> Self {
        Self { inverse: self.slope.dot(offset) + self.inverse, slope: self.slope }
    }

    /// The plane through a point at 1/`inverse` on `ray`, with this normal towards the camera, in the camera's frame.
    #[inline(always)]
    pub(super) fn facing(inverse: f32, normal: Vec3, ray: Vec3, focal: Vec2) -> Self {
        let m = normal * (inverse / normal.dot(ray));
        Self { inverse, slope: m.truncate() / focal }
    }

    /// Minus the normal over the distance, in the camera's frame.
    #[inline(always)]
    fn covector(self, ray: Vec3, focal: Vec2) -> Vec3 {
        let across = self.slope * focal;
        across.extend(self.inverse - across.dot(ray.truncate()))
    }

    /// The unit normal towards the camera, in the camera's frame.
    #[inline(always)]
    pub(super) fn normal(self, ray: Vec3, focal: Vec2) -> Vec3 {
        -self.covector(ray, focal).normalize_or(Vec3::Z)
    }

    /// True when the plane faces the camera, not at a grazing angle.
    #[inline(always)]
    pub(super) fn is_visible(self, ray: Vec3, focal: Vec2) -> bool {
        let m = self.covector(ray, focal);
        self.inverse > 0.0
            && self.inverse * self.inverse
                > LEAST_COSINE * LEAST_COSINE * m.length_squared() * ray.length_squared()
    }
}

/// The ray through a pixel's centre, of depth 1.
#[inline(always)]
pub(super) fn ray(camera: &Camera, x: usize, y: usize) -> Vec3 {
    let middle = Vec2::new(x as f32 + 0.5, y as f32 + 0.5);
    ((middle - camera.center) / camera.focal).extend(1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_keeps_its_normal_from_pixel_to_pixel() {
        let focal = Vec2::new(100.0, 90.0);
        let (here, there) = (Vec3::new(0.1, -0.2, 1.0), Vec3::new(0.15, -0.1, 1.0));
        let normal = Vec3::new(0.3, 0.2, -0.8).normalize();
        let plane = Plane::facing(0.5, normal, here, focal);
        assert!((plane.normal(here, focal) - normal).length() < 1e-5);
        let moved = plane.at((there - here).truncate() * focal);
        assert!((moved.normal(there, focal) - normal).length() < 1e-5);
        // Both points are on one plane: n · p is the same.
        let (p, q) = (here / plane.inverse, there / moved.inverse);
        assert!((normal.dot(p) - normal.dot(q)).abs() < 1e-5);
        assert!(plane.is_visible(here, focal) && !Plane { inverse: -0.5, ..plane }.is_visible(here, focal));
        let grazing = Plane::facing(0.5, Vec3::new(1.0, 0.0, -0.05).normalize(), Vec3::Z, focal);
        assert!(!grazing.is_visible(Vec3::Z, focal));
    }
}
