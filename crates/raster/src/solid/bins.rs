//! Triangles on the grid of samples, and the bins of the tiles that they touch.

use super::projector::GRID;
use glam::UVec2;
use std::ops::Range;

/// Width of a tile, samples.
pub(super) const TILE_WIDTH: usize = 64;
/// Height of a tile, samples.
pub(super) const TILE_HEIGHT: usize = 32;
/// Half a sample on the grid: the offset of its centre.
pub(super) const CENTER: i32 = GRID / 2;
/// Largest extent of a tiny triangle, units of the grid: single precision holds its edge functions exactly.
pub(super) const TINY: i32 = 8 * GRID;

/// A triangle on the grid: corners and their 1/z.
#[derive(Debug, Clone, Copy)]
pub(super) struct SnappedTriangle {
    pub(super) x: [i32; 3],
    pub(super) y: [i32; 3],
    pub(super) w: [f32; 3],
}

impl SnappedTriangle {
    /// 1/z of the nearest corner, which bounds the triangle.
    #[inline(always)]
    pub(super) fn nearest(&self) -> f32 {
        self.w[0].max(self.w[1]).max(self.w[2])
    }
}

/// A tiny triangle; its corners are relative to the corner of its tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct TinyTriangle {
    pub(super) x: [i16; 3],
    pub(super) y: [i16; 3],
    pub(super) w: [f32; 3],
    pub(super) face: u32,
}

impl TinyTriangle {
    /// For the tile at `column` and `row`.
    #[inline(always)]
    pub(super) fn new(at: &SnappedTriangle, face: u32, column: i32, row: i32) -> Self {
        let (left, top) = (column * TILE_WIDTH as i32 * GRID, row * TILE_HEIGHT as i32 * GRID);
        let x = [(at.x[0] - left) as i16, (at.x[1] - left) as i16, (at.x[2] - left) as i16];
        let y = [(at.y[0] - top) as i16, (at.y[1] - top) as i16, (at.y[2] - top) as i16];
        Self { x, y, w: at.w, face }
    }
}

/// A triangle that is not tiny.
#[derive(Debug, Clone, Copy)]
pub(super) struct LargeTriangle {
    pub(super) at: SnappedTriangle,
    pub(super) face: u32,
}

/// The triangles of a batch that touch a tile.
#[derive(Debug, Default)]
pub(super) struct TileBin {
    pub(super) tiny: Vec<TinyTriangle>,
    /// Indices into the batch's list.
    pub(super) large: Vec<u32>,
}

/// The triangles of a range of faces, up to the limit.
#[derive(Debug, Default)]
pub(super) struct Batch {
    /// One per tile, row by row.
    pub(super) bins: Vec<TileBin>,
    pub(super) large: Vec<LargeTriangle>,
    /// Pairs of triangles and tiles in the bins.
    pub(super) pairs: usize,
    /// Faces that are not in the bins yet.
    pub(super) left: Range<usize>,
}

impl Batch {
    /// Empties the batch, with a bin for each of `tiles` tiles.
    pub(super) fn empty(&mut self, tiles: usize) {
        self.large.clear();
        self.pairs = 0;
        self.bins.resize_with(tiles, TileBin::default);
        for bin in &mut self.bins {
            bin.tiny.clear();
            bin.large.clear();
        }
    }
}

/// Tiles across and down.
pub(super) fn tile_count(size: UVec2) -> UVec2 {
    UVec2::new(size.x.div_ceil(TILE_WIDTH as u32), size.y.div_ceil(TILE_HEIGHT as u32))
}

/// Samples `first..=last` whose centres lie in [low, high] on the grid.
#[inline(always)]
pub(super) fn samples_between(low: i32, high: i32) -> (i32, i32) {
    ((low + GRID / 2 - 1) >> 8, (high - GRID / 2) >> 8)
}

/// Smallest and largest of three.
#[inline(always)]
pub(super) fn extent(values: [i32; 3]) -> (i32, i32) {
    (values[0].min(values[1]).min(values[2]), values[0].max(values[1]).max(values[2]))
}

/// The smallest value of an edge function that counts as inside (the top-left rule): 0 for a top or left edge, 1
/// for the others, whose samples belong to the neighbour.
#[inline(always)]
pub(super) fn least_inside(dx: i32, dy: i32) -> i32 {
    i32::from(!(dy < 0 || (dy == 0 && dx > 0)))
}
