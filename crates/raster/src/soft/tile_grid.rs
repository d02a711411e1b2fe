//! Tiles of 16x16 pixels and their blocks of 4x4, one pixel per lane.

use glam::UVec2;
use trisplat_scene::math::lanes::LANES;

/// Tile width and height, px.
pub const TILE: u32 = 16;
/// Blocks in a tile: equal to [`LANES`], so that all are tested at once.
pub(super) const BLOCKS: usize = LANES;

/// Margin of every test, px: larger than any rounding, so that a test never changes a pixel.
pub const MARGIN: f32 = 0.01;

/// x and y of the lanes in a block, px.
pub(super) const LANE_X: [f32; LANES] = grid(1.0, 0.0, 0.0);
pub(super) const LANE_Y: [f32; LANES] = grid(0.0, 1.0, 0.0);
/// x and y of the blocks' centres in a tile, px.
pub(super) const BLOCK_X: [f32; BLOCKS] = grid(4.0, 0.0, 2.0);
pub(super) const BLOCK_Y: [f32; BLOCKS] = grid(0.0, 4.0, 2.0);

const fn grid(x: f32, y: f32, offset: f32) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    let mut i = 0;
    while i < LANES {
        out[i] = (i % 4) as f32 * x + (i / 4) as f32 * y + offset;
        i += 1;
    }
    out
}

/// Tiles across and down a picture.
pub fn tile_count(size: UVec2) -> UVec2 {
    UVec2::new(size.x.div_ceil(TILE), size.y.div_ceil(TILE))
}

/// Tiles `from..=to` that hold a pixel centre in [lo, hi]; none when from > to.
#[inline(always)]
pub(super) fn tiles_between(lo: f32, hi: f32, size: f32) -> (u32, u32) {
    let first = (lo - 0.5 - MARGIN).ceil().max(0.0);
    let last = (hi - 0.5 + MARGIN).floor().min(size - 1.0);
    if first <= last { (first as u32 / TILE, last as u32 / TILE) } else { (1, 0) }
}

/// Top left pixel of block `block` of the tile at `corner`.
#[inline(always)]
pub(super) fn block_corner(corner: UVec2, block: usize) -> [f32; 2] {
    [(corner.x + 4 * (block as u32 % 4)) as f32, (corner.y + 4 * (block as u32 / 4)) as f32]
}

/// One bit for each pixel of the block that lies in the image.
#[inline(always)]
pub(super) fn inside(size: UVec2, corner: UVec2, block: usize) -> u16 {
    let mut bits = 0;
    for lane in 0..LANES {
        let (x, y) = pixel(corner, block, lane);
        bits |= u16::from(x < size.x && y < size.y) << lane;
    }
    bits
}

/// Whether the whole tile lies in the image.
#[inline(always)]
pub(super) fn is_whole(size: UVec2, corner: UVec2) -> bool {
    corner.x + TILE <= size.x && corner.y + TILE <= size.y
}

/// Column and row of a lane.
#[inline(always)]
pub(super) fn pixel(corner: UVec2, block: usize, lane: usize) -> (u32, u32) {
    let (block, lane) = (block as u32, lane as u32);
    (corner.x + 4 * (block % 4) + lane % 4, corner.y + 4 * (block / 4) + lane / 4)
}
