//! Finds triangles behind all visible samples of a tile, which need not be drawn.

use super::bins::{TILE_HEIGHT, TILE_WIDTH, tile_count};
use super::keys::{STRIDE, SampleKeys, inverse_depth_of};
use glam::UVec2;
use std::ops::RangeInclusive;
use trisplat_scene::parallel;

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
