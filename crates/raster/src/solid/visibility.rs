//! The face and depth of every sample, and the barycentric coordinates there.

use super::projector::Projector;
use glam::{DVec3, UVec2, Vec2, Vec3};
use trisplat_scene::{camera::Camera, mesh::Mesh};

/// The face number of an empty sample.
pub const NO_FACE: u32 = u32::MAX;

/// The face of each sample. `[height * width]`, row by row, in samples
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Visibility {
    /// Width and height, samples: the camera's size times the samples along an axis.
    pub size: UVec2,
    /// Face seen, or [`NO_FACE`].
    pub face: Vec<u32>,
    /// Depth z in the camera's frame, units of the mesh; infinite for empty samples.
    pub depth: Vec<f32>,
}

impl Visibility {
    /// Perspective-correct barycentric coordinates of the face at a sample, for interpolating colours. In [0,
    /// 1], sum 1; zeros for empty samples. Mesh and camera must be those of the drawing.
    pub fn barycentrics(&self, mesh: &Mesh, camera: &Camera, x: u32, y: u32) -> [f32; 3] {
        let face = self.face[(y * self.size.x + x) as usize];
        if face == NO_FACE {
            return [0.0; 3];
        }
        let barycentrics = Barycentrics::new(mesh, camera, self.size.x / camera.size.x);
        barycentrics.weights(&barycentrics.face(face), x, y)
    }
}

/// Perspective-correct barycentric coordinates of many samples of few faces.
#[derive(Debug, Clone)]
pub struct Barycentrics<'a> {
    mesh: &'a Mesh,
    projector: Projector,
}

impl<'a> Barycentrics<'a> {
    /// For a mesh and camera with `samples` samples along each axis of a pixel.
    pub fn new(mesh: &'a Mesh, camera: &Camera, samples: u32) -> Self {
        Self { mesh, projector: Projector::new(camera, samples, 0.0) }
    }

    /// What [`Barycentrics::weights`] needs of a face.
    pub fn face(&self, face: u32) -> FaceBarycentrics {
        FaceBarycentrics::new(&self.projector, self.mesh.corners(face as usize))
    }

    /// [`Self::weights`] in the middle of a pixel.
    #[inline(always)]
    pub fn weights_in_pixel(&self, face: &FaceBarycentrics, x: u32, y: u32) -> [f32; 3] {
        face.weights(self.projector.ray_in_pixel(x, y))
    }

    /// Perspective-correct weights of a face's corners at a sample; in [0, 1], sum 1.
    #[inline(always)]
    pub fn weights(&self, face: &FaceBarycentrics, x: u32, y: u32) -> [f32; 3] {
        face.weights(self.projector.ray(x, y))
    }
}

/// The values of a face for barycentric coordinates.
#[derive(Debug, Clone, Copy)]
pub struct FaceBarycentrics {
    /// Corner i's weight is proportional to the dot product of the i-th vector and the ray.
    opposite: [DVec3; 3],
}

impl FaceBarycentrics {
    pub(super) fn new(projector: &Projector, corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners.map(|v| projector.to_camera_f64(v));
        Self { opposite: [b.cross(c), c.cross(a), a.cross(b)] }
    }

    /// Interpolates values of corners where a ray meets the face's plane, within the face or beyond it.
    pub(super) fn mixed(&self, ray: DVec3, of_corners: &[Vec2; 3]) -> Vec2 {
        let parts = self.opposite.map(|n| n.dot(ray));
        let per = 1.0 / (parts[0] + parts[1] + parts[2]);
        let mix = |k: usize| of_corners[k].as_dvec2() * (parts[k] * per);
        (mix(0) + mix(1) + mix(2)).as_vec2()
    }

    /// The same within the face.
    pub(super) fn inside(&self, ray: DVec3, of_corners: &[Vec2; 3]) -> Vec2 {
        let weights = self.weights(ray);
        of_corners[0] * weights[0] + of_corners[1] * weights[1] + of_corners[2] * weights[2]
    }

    /// Weights of the corners where a ray meets the face's plane; at least 0, sum 1.
    #[inline(always)]
    fn weights(&self, ray: DVec3) -> [f32; 3] {
        let parts = self.opposite.map(|n| n.dot(ray));
        let per = 1.0 / (parts[0] + parts[1] + parts[2]);
        // Snapping moved the corners, so a sample may lie slightly outside.
        let kept = parts.map(|p| (p * per).max(0.0));
        let sum = kept[0] + kept[1] + kept[2];
        if !(sum > 0.0 && sum.is_finite()) {
            return [1.0 / 3.0; 3];
        }
        kept.map(|p| (p / sum) as f32)
    }
}
