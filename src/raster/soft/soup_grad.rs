//! The gradient of a loss with respect to a soup.

use crate::camera::Camera;
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Gradient of a loss L with respect to a soup; rows of triangles that are not `visible` are zero.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SoupGrad {
    /// ∂L/∂vertices. `[N, 3]`
    pub vertices: Vec<[Vec3; 3]>,
    /// ∂L/∂opacity. `[N]`
    pub opacity: Vec<f32>,
    /// ∂L/∂sigma. `[N]`
    pub sigma: Vec<f32>,
    /// ∂L/∂sh. `[N * K]`
    pub sh: Vec<[f32; 3]>,
    /// Each triangle's share of [`FrameGrad::error`](super::FrameGrad::error), Σ w error over the pixels. `[N]`
    pub error: Vec<f32>,
    /// Triangles that were drawn on at least one pixel, ascending.
    pub visible: Vec<u32>,
    /// Triangles whose gradient was not finite; their rows were set to zero.
    pub dropped: usize,
}

/// Gradient of a loss L with respect to a small motion of the camera: its points q = R v + t become
/// q + rotation × q + translation.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CameraGrad {
    /// ∂L/∂rotation, about the camera's own axes, per radian.
    pub rotation: DVec3,
    /// ∂L/∂translation, along the camera's own axes.
    pub translation: DVec3,
}

impl SoupGrad {
    /// The gradient of the camera's motion: moving the camera moves all corners the other way. View-dependent
    /// colour is the exception, because a camera that only turns sees every triangle from the same direction;
    /// here its colour changes as if the scene turned. The sum runs in order, so it has the same bits for any
    /// number of threads.
    pub fn camera(&self, vertices: &[[Vec3; 3]], camera: &Camera) -> CameraGrad {
        let eye = camera.position();
        let (mut turn, mut push) = (DVec3::ZERO, DVec3::ZERO);
        for &i in &self.visible {
            for (v, d) in vertices[i as usize].iter().zip(&self.vertices[i as usize]) {
                let d = d.as_dvec3();
                turn += (*v - eye).as_dvec3().cross(d);
                push += d;
            }
        }
        let rotation = camera.rotation.as_dmat3();
        CameraGrad { rotation: rotation * turn, translation: rotation * push }
    }

    /// Those of the visible triangles that are in a range.
    pub(crate) fn visible_in(&self, triangles: Range<usize>) -> &[u32] {
        let at = |end: usize| self.visible.partition_point(|&t| (t as usize) < end);
        &self.visible[at(triangles.start)..at(triangles.end)]
    }
}
