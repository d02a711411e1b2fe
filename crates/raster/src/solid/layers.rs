//! Draws the larger triangles of a tile; deep tiles are drawn front to back, until the rest is hidden.
//!
//! Ordinary tiles are drawn without sorting, which would cost more than it saves. When the drawn area shows
//! that a tile is deep, the nearest triangles of a batch are drawn first, and triangles behind all samples
//! are dropped. So time grows with the visible layers.

use super::bins::{Batch, LargeTriangle, TILE_HEIGHT, TILE_WIDTH, extent};
use super::hidden::farthest;
use super::keys::SampleKeys;
use super::projector::GRID;
use super::spans::draw_large;
use glam::UVec2;
use trisplat_scene::math::lanes::Lanes;

/// Layers over the whole tile, by the boxes of its triangles, after which it counts as deep.
const DEEP: i64 = 24;
/// Least triangles of a batch for this search, and the number of nearest ones drawn first.
const NEAREST: usize = 16;

/// The drawing of a tile so far.
pub(super) struct TileLayers {
    /// Samples of the tile that lie in the picture.
    size: UVec2,
    /// Area of the boxes of the triangles that were drawn, cut to the tile, in units of the grid.
    area: i64,
}

impl TileLayers {
    /// Nothing was drawn.
    pub(super) fn new(size: UVec2) -> Self {
        Self { size, area: 0 }
    }

    /// Draws triangles of a batch; `corner` is the first sample of the tile.
    #[inline(always)]
    pub(super) fn draw<L: Lanes>(
        &mut self,
        keys: &mut SampleKeys,
        batch: &Batch,
        large: &[u32],
        corner: [i32; 2],
    ) {
        const TILE_AREA: i64 = (TILE_WIDTH as i64 * GRID as i64) * (TILE_HEIGHT as i64 * GRID as i64);
        for (i, place) in large.iter().enumerate() {
            if self.area > DEEP * TILE_AREA && large.len() - i > NEAREST {
                return self.draw_deep::<L>(keys, batch, &large[i..], corner);
            }
            let large = &batch.large[*place as usize];
            draw_large::<L>(keys, large, corner);
            self.area += area_in_tile(large, corner);
        }
    }

    /// Draws the nearest of some triangles, drops what is hidden then, and continues with twice as many.
    #[inline(always)]
    fn draw_deep<L: Lanes>(&self, keys: &mut SampleKeys, batch: &Batch, large: &[u32], corner: [i32; 2]) {
        let nearest = |place: u32| batch.large[place as usize].at.nearest();
        let mut left: Vec<(f32, u32)> = large.iter().map(|place| (nearest(*place), *place)).collect();
        let mut count = NEAREST;
        loop {
            let hidden_from = farthest(keys, self.size);
            left.retain(|(nearest, _)| *nearest >= hidden_from);
            if left.is_empty() {
                return;
            }
            let first = count.min(left.len());
            // Which triangles come first changes the time, not the picture: the nearest face wins in any order.
            left.select_nth_unstable_by(first - 1, |a, b| b.0.total_cmp(&a.0));
            for (_, place) in left.drain(..first) {
                draw_large::<L>(keys, &batch.large[place as usize], corner);
            }
            count *= 2;
        }
    }
}

/// The area of a triangle's box within the tile, in units of the grid.
#[inline(always)]
fn area_in_tile(large: &LargeTriangle, corner: [i32; 2]) -> i64 {
    let within = |values: [i32; 3], corner: i32, samples: usize| {
        let (low, high) = extent(values);
        let (from, to) = (corner * GRID, (corner + samples as i32) * GRID);
        i64::from((high.min(to) - low.max(from)).max(0))
    };
    within(large.at.x, corner[0], TILE_WIDTH) * within(large.at.y, corner[1], TILE_HEIGHT)
}
