//! The face and depth of every sample.

use super::barycentric::Barycentrics;
use glam::UVec2;
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;

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
