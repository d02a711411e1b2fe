//! Depth, normal and confidence of the surfaces in one photo.

use crate::camera::Camera;
use glam::{Vec2, Vec3};

/// Depth of a pixel without an estimate.
pub const UNKNOWN: f32 = 0.0;

/// Depth, normal and confidence of each pixel of a photo.
#[derive(Debug, Clone, PartialEq)]
pub struct DepthMap {
    /// The photo's camera, at the size of the map.
    pub camera: Camera,
    /// Depth z in the camera's frame, units of the data set; [`UNKNOWN`] (0) without an estimate, infinite
    /// for the sky. `[height * width]`
    pub depth: Vec<f32>,
    /// Unit normal towards the camera, in the world; zero without a depth. `[height * width]`
    pub normal: Vec<Vec3>,
    /// Confidence of the depth, from 0 (no estimate) to 1. `[height * width]`
    pub confidence: Vec<f32>,
    /// The photo, sRGB-encoded. `[height * width]`
    pub rgb: Vec<[u8; 3]>,
}

impl DepthMap {
    /// A map without answers.
    pub fn unknown(camera: Camera, rgb: Vec<[u8; 3]>) -> Self {
        let pixels = rgb.len();
        Self {
            camera,
            rgb,
            depth: vec![UNKNOWN; pixels],
            normal: vec![Vec3::ZERO; pixels],
            confidence: vec![0.0; pixels],
        }
    }

    /// True where a pixel has a finite depth.
    pub fn is_known(&self, pixel: usize) -> bool {
        self.depth[pixel] > 0.0 && self.depth[pixel].is_finite()
    }

    /// Share of the pixels with a finite depth.
    pub fn known_share(&self) -> f64 {
        let known = (0..self.depth.len()).filter(|pixel| self.is_known(*pixel)).count();
        known as f64 / self.depth.len().max(1) as f64
    }

    /// The point of the world at the centre of a pixel; `None` without a finite depth.
    pub fn point(&self, pixel: usize) -> Option<Vec3> {
        self.is_known(pixel).then(|| self.unproject(pixel, self.depth[pixel]))
    }

    /// The point of the world on a pixel's ray at this depth.
    pub fn unproject(&self, pixel: usize, depth: f32) -> Vec3 {
        let camera = &self.camera;
        let width = camera.size.x as usize;
        let middle = Vec2::new((pixel % width) as f32 + 0.5, (pixel / width) as f32 + 0.5);
        let ray = ((middle - camera.center) / camera.focal).extend(1.0);
        camera.rotation.transpose() * (ray * depth - camera.translation)
    }

    /// The pixel of a point of the world, hidden or not, and the point's depth; `None` outside the picture.
    pub fn pixel(&self, point: Vec3) -> Option<(usize, f32)> {
        let camera = &self.camera;
        let v = camera.rotation * point + camera.translation;
        if !(v.z > 0.0) {
            return None;
        }
        let at = v.truncate() / v.z * camera.focal + camera.center;
        let inside = at.cmpge(Vec2::ZERO).all() && at.cmplt(camera.size.as_vec2()).all();
        inside.then(|| (at.y as usize * camera.size.x as usize + at.x as usize, v.z))
    }

    /// Removes the estimate of a pixel.
    pub(super) fn forget(&mut self, pixel: usize) {
        self.depth[pixel] = UNKNOWN;
        self.normal[pixel] = Vec3::ZERO;
        self.confidence[pixel] = 0.0;
    }
}
