//! The tiles that still pass light, while splats are drawn slab by slab.

use super::splats::ScreenBox;
use super::tile_grid::{tile_count, tiles_between};
use super::tile_pixels::TilePixels;
use glam::UVec2;

/// The tiles in which some pixel has not terminated.
#[derive(Debug)]
pub(super) struct OpenTiles {
    /// Image size, px.
    size: [f32; 2],
    /// Tiles across and down.
    count: UVec2,
    /// Open tiles above and left of each corner between tiles. `[(down + 1) * (across + 1)]`
    sums: Vec<u32>,
}

impl OpenTiles {
    /// All tiles open.
    pub(super) fn all(size: UVec2) -> Self {
        let count = tile_count(size);
        let mut out = Self { size: size.as_vec2().to_array(), count, sums: Vec::new() };
        out.sum(|_| true);
        out
    }

    /// Closes the tiles whose pixels have all terminated. `[down * across]`
    pub(super) fn close(&mut self, pixels: &[TilePixels]) {
        self.sum(|tile| pixels[tile].alive != 0);
    }

    fn sum(&mut self, open: impl Fn(usize) -> bool) {
        let (across, down) = (self.count.x as usize, self.count.y as usize);
        self.sums.clear();
        self.sums.resize((across + 1) * (down + 1), 0);
        for y in 0..down {
            let mut row = 0;
            for x in 0..across {
                row += u32::from(open(y * across + x));
                self.sums[(y + 1) * (across + 1) + x + 1] = self.sums[y * (across + 1) + x + 1] + row;
            }
        }
    }

    /// Whether any tile is open.
    pub(super) fn any(&self) -> bool {
        self.sums.last().is_some_and(|open| *open > 0)
    }

    /// Open tiles that a box touches.
    pub(super) fn count(&self, bounds: &ScreenBox) -> u32 {
        let (x0, x1) = tiles_between(bounds.lo[0], bounds.hi[0], self.size[0]);
        let (y0, y1) = tiles_between(bounds.lo[1], bounds.hi[1], self.size[1]);
        if x0 > x1 || y0 > y1 { 0 } else { self.count_within([x0, y0], [x1 + 1, y1 + 1]) }
    }

    /// Whether the tile is open.
    pub(super) fn is_open(&self, x: u32, y: u32) -> bool {
        self.count_within([x, y], [x + 1, y + 1]) > 0
    }

    fn count_within(&self, from: [u32; 2], to: [u32; 2]) -> u32 {
        let at = |x: u32, y: u32| self.sums[(y * (self.count.x + 1) + x) as usize];
        at(to[0], to[1]) + at(from[0], from[1]) - at(to[0], from[1]) - at(from[0], to[1])
    }
}
