//! Tiles, the bins of faces in them, and the nearest face of every sample as one number.

use super::projector::GRID;
use glam::UVec2;
use std::ops::{Range, RangeInclusive};
use trisplat_scene::parallel;

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

/// Samples by which a block may extend beyond its tile on the right and below; enough to keep runs of `spans`
/// within the keys.
const RIM: usize = 3;
/// Keys from one row of a tile to the next.
pub(super) const STRIDE: usize = TILE_WIDTH + RIM;

/// The key of a sample: 1/z in the upper half, the complement of the face in the lower. The larger key is
/// nearer or, at the same depth, has the lower face index. Zero means empty; negative keys lose to it.
pub(super) type SampleKey = i64;

/// The samples of a tile and a rim that is never read.
pub(super) type SampleKeys = [SampleKey; STRIDE * (TILE_HEIGHT + RIM)];

/// A tile that sees nothing.
pub(super) static EMPTY: SampleKeys = [0; STRIDE * (TILE_HEIGHT + RIM)];

/// The face of a key; `NO_FACE` for none.
#[inline(always)]
pub(super) fn face_of(key: SampleKey) -> u32 {
    !(key as u32)
}

/// The 1/z of a key.
#[inline(always)]
pub(super) fn inverse_depth_of(key: SampleKey) -> f32 {
    f32::from_bits((key >> 32) as u32)
}

/// The key of a face at a 1/z.
#[inline(always)]
pub(super) fn key(w: f32, face: u32) -> SampleKey {
    (i64::from(w.to_bits().cast_signed()) << 32) | i64::from(!face)
}

/// The least 1/z of a tile's samples: 0 if one is empty. `size` are the samples of the tile within the
/// picture.
pub(super) fn farthest(keys: &SampleKeys, size: UVec2) -> f32 {
    let rows = keys.chunks(STRIDE).take(size.y as usize);
    let least = rows.map(|row| row[..size.x as usize].iter().copied().min().unwrap_or(0));
    inverse_depth_of(least.min().unwrap_or(0))
}

/// Samples of the tile at `column`, `row` that lie in a picture of `size` samples.
pub(super) fn tile_size(size: UVec2, column: u32, row: u32) -> UVec2 {
    let tile = UVec2::new(TILE_WIDTH as u32, TILE_HEIGHT as u32);
    tile.min(size - UVec2::new(column, row) * tile)
}

/// The farthest depth of each tile's samples, as 1/z.
#[derive(Debug)]
pub(super) struct TileDepths {
    tiles: Vec<f32>,
    /// The least of each row of tiles.
    rows: Vec<f32>,
}

impl TileDepths {
    /// From the keys of all tiles, with `planes` for each; hidden means hidden in all planes. `[tiles *
    /// planes]`
    pub(super) fn new(keys: &[SampleKeys], planes: usize, size: UVec2) -> Self {
        let across = tile_count(size).x;
        let of_tile = |tile: usize, planes: &[SampleKeys]| {
            let size = tile_size(size, tile as u32 % across, tile as u32 / across);
            planes.iter().map(|keys| farthest(keys, size)).fold(f32::INFINITY, f32::min)
        };
        let tiles: Vec<f32> = parallel::map(keys.chunks(planes), of_tile);
        let least = |row: &[f32]| row.iter().copied().fold(f32::INFINITY, f32::min);
        let rows = tiles.chunks(across as usize).map(least).collect();
        Self { tiles, rows }
    }

    /// Whether a tile hides a triangle whose nearest corner has the 1/z `nearest`. An equal depth is not
    /// hidden, because the lower face index wins.
    #[inline(always)]
    pub(super) fn hides(&self, tile: usize, nearest: f32) -> bool {
        nearest < self.tiles[tile]
    }

    /// Whether whole rows of tiles hide it.
    #[inline(always)]
    pub(super) fn hides_all(&self, rows: &RangeInclusive<i32>, nearest: f32) -> bool {
        self.rows[*rows.start() as usize..=*rows.end() as usize].iter().all(|least| nearest < *least)
    }
}
