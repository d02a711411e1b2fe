//! The number of layers of each pixel (Held et al. 2025, supplement, "Number of contributions per pixel").

use super::broadcast::{BroadcastSplat, PixelLimits};
use super::options::SoftOptions;
use super::splats::Splats;
use super::tile_grid::{self, BLOCKS, TILE};
use super::tiles::{TileEntry, Tiles};
use crate::kernel::composite;
use glam::UVec2;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::parallel;

/// Layers drawn on each pixel of a tile, block by block.
type LayerCounts = [[u32; LANES]; BLOCKS];

/// Layers drawn on each pixel, by drawing the tiles again after the forward pass. `[height * width]`
pub(super) fn contributions(splats: &Splats, tiles: &Tiles, options: &SoftOptions) -> Vec<u32> {
    let size = tiles.size;
    let counted: Vec<LayerCounts> = parallel::map(0..tiles.len(), |_, tile| {
        let entries = tiles.entries_of(tile);
        dispatch(CountTile { splats, entries, corner: tiles.corner(tile), size, options })
    });
    let pixel = |i: u32| {
        let (x, y) = (i % size.x, i / size.x);
        let tile = (y / TILE) * tiles.count.x + x / TILE;
        let (x, y) = (x % TILE, y % TILE);
        counted[tile as usize][((y / 4) * 4 + x / 4) as usize][((y % 4) * 4 + x % 4) as usize]
    };
    (0..size.x * size.y).map(pixel).collect()
}

/// One tile.
struct CountTile<'a> {
    splats: &'a Splats,
    /// Runs after the forward pass, with the blocks where each splat was drawn.
    entries: &'a [TileEntry],
    corner: UVec2,
    size: UVec2,
    options: &'a SoftOptions,
}

impl Work for CountTile<'_> {
    type Output = LayerCounts;

    #[inline(always)]
    fn run<L: Lanes>(self) -> LayerCounts {
        let limits = PixelLimits::new(self.options);
        let mut counts = [[0; LANES]; BLOCKS];
        let mut transmittance = [[0.0; LANES]; BLOCKS];
        for (block, lanes) in transmittance.iter_mut().enumerate() {
            let inside = tile_grid::inside(self.size, self.corner, block);
            *lanes = std::array::from_fn(|lane| f32::from(inside >> lane & 1));
        }
        for entry in self.entries {
            let splat = BroadcastSplat::<L>::new(&self.splats.records[entry.splat as usize]);
            let mut left = entry.blocks;
            while left != 0 {
                let b = left.trailing_zeros() as usize & (BLOCKS - 1);
                left &= left - 1;
                let before = L::load(&transmittance[b]);
                let corner = tile_grid::block_corner(self.corner, b);
                let Some(shade) = splat.shade(corner, before, &limits) else { continue };
                composite::blend(before, shade.alpha).1.store(&mut transmittance[b]);
                let drawn = L::bits(shade.drawn);
                for (lane, count) in counts[b].iter_mut().enumerate() {
                    *count += u32::from(drawn >> lane & 1 == 1);
                }
            }
        }
        counts
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Importance, SoftRasterizer, SoupRef};
    use super::*;
    use glam::{Mat3, Vec2, Vec3};
    use trisplat_scene::Rng;
    use trisplat_scene::Soup;
    use trisplat_scene::camera::Camera;

    fn soup(count: usize) -> Soup {
        let rng = Rng::new(5, "contributions", 0);
        let draw = |i: usize| rng.uniform(i as u64);
        let corner =
            |i: usize| Vec3::new(3.0 * draw(3 * i) - 1.5, 2.4 * draw(3 * i + 1) - 1.2, 2.0 + draw(3 * i + 2));
        let triangle = |t: usize| [0, 1, 2].map(|c| corner(3 * t + c));
        Soup {
            vertices: (0..count).map(triangle).collect(),
            opacity: (0..count).map(|i| 0.1 + 0.8 * draw(i)).collect(),
            sigma: (0..count).map(|i| 0.2 + draw(i)).collect(),
            sh: vec![[0.3; 3]; count],
            sh_degree: 0,
            ..Soup::default()
        }
    }

    #[test]
    fn pixels_and_triangles_count_the_same_layers() {
        let camera = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::splat(60.0),
            center: Vec2::new(37.0, 26.0),
            size: UVec2::new(75, 53),
        };
        let options = SoftOptions { importance: true, ..SoftOptions::default() };
        for count in [0, 1, 300] {
            let soup = soup(count);
            let mut soft = SoftRasterizer::new();
            let frame = soft.render(&SoupRef::from(&soup), &camera, &options);
            let bare: Vec<bool> = frame.transmittance.iter().map(|&t| t == 1.0).collect();
            let layers = soft.contributions(&options);
            let mut importance = Importance::new(count);
            soft.accumulate_importance(&mut importance);
            assert_eq!(layers.iter().sum::<u32>(), importance.pixels.iter().sum::<u32>());
            assert!(layers.iter().zip(bare).all(|(&n, bare)| (n == 0) == bare));
            assert!(count < 300 || layers.iter().any(|&n| n > 10));
        }
    }
}
