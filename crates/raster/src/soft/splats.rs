//! The splats of a frame: first in the order of the triangles, then by depth.

use super::sort::DepthKey;
use crate::kernel::clip::Piece;
use crate::kernel::splat::DepthPlane;

/// Triangles that one task projects; also the unit of the gradient gather.
pub(super) const CHUNK: usize = 1024;

/// Records are prefetched this many splats ahead.
pub(super) const PREFETCH_AHEAD: usize = 6;

/// A splat's record for pixels: one cache line. With `Window::Coverage` `edge` and `shift` are in widths of
/// its ramp and `floor` is the smallest coverage drawn; else they are in inradii, and the smallest ratio.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(super) struct SplatRecord {
    pub(super) origin: [f32; 2],
    pub(super) edge: [[f32; 2]; 3],
    pub(super) shift: f32,
    pub(super) floor: f32,
    pub(super) sigma: f32,
    pub(super) log2_opacity: f32,
    pub(super) rgb: [f32; 3],
    pub(super) triangle: u32,
}

/// Box of the drawn region, px.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ScreenBox {
    pub(super) lo: [f32; 2],
    pub(super) hi: [f32; 2],
}

/// A splat before the sort.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProjectedSplat {
    pub(super) record: SplatRecord,
    pub(super) bounds: ScreenBox,
    pub(super) plane: DepthPlane<f32>,
    pub(super) piece: Piece,
    /// Largest distance of a corner from the centroid, px.
    pub(super) radius_px: f32,
    /// Its index after the sort.
    pub(super) rank: u32,
}

/// The splats of one chunk of triangles, in the triangles' order.
#[derive(Debug, Default)]
pub(super) struct SplatChunk {
    pub(super) projected: Vec<ProjectedSplat>,
    /// Bits of their depths.
    pub(super) depths: Vec<u32>,
}

/// The splats in depth order, as parallel arrays.
#[derive(Debug, Default)]
pub(super) struct Splats {
    pub(super) records: Vec<SplatRecord>,
    pub(super) bounds: Vec<ScreenBox>,
    pub(super) planes: Vec<DepthPlane<f32>>,
}

impl Splats {
    pub(super) fn len(&self) -> usize {
        self.records.len()
    }
}

/// All splats of a frame.
#[derive(Debug, Default)]
pub(super) struct Projection {
    pub(super) chunks: Vec<SplatChunk>,
    pub(super) splats: Splats,
    /// Triangles of the soup.
    pub(super) triangles: usize,
    pub(super) keys: Vec<DepthKey>,
    pub(super) scratch: Vec<DepthKey>,
}
