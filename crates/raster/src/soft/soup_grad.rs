//! The gradient of a loss with respect to a soup.

use glam::Vec3;
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

impl SoupGrad {
    /// Those of the visible triangles that are in a range.
    pub fn visible_in(&self, triangles: Range<usize>) -> &[u32] {
        let at = |end: usize| self.visible.partition_point(|&t| (t as usize) < end);
        &self.visible[at(triangles.start)..at(triangles.end)]
    }
}
