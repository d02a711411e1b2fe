//! Draws deep scenes slab by slab, front to back, so that memory and time grow with the visible layers, not
//! with those behind them.
//!
//! Splats are drawn front to back; once every pixel of a tile has terminated, nothing behind needs a place in
//! its list. A list of all (splat, tile) pairs cannot use this: 100,000 triangles that fill 1280x720 px have
//! 360 million pairs. A frame with more pairs than [`PAIRS_PER_SLAB`] is therefore drawn in several slabs of
//! splats, and closed tiles are omitted from later ones. Pixels, weights and gradients are bitwise the same.

use super::CountedPixels;
use super::forward::{self, Slab};
use super::frame::{SoftOptions, Sort};
use super::slots::WeightSlot;
use super::splats::{ScreenBox, Splats};
use super::tiles::OpenTiles;
use super::tiles::TILE;
use super::tiles::TilePixels;
use super::tiles::{KeptPairs, Tiles};
use glam::UVec2;
use std::ops::Range;

/// Most pairs of a slab; each takes 20 bytes while it is drawn.
pub(super) const PAIRS_PER_SLAB: u64 = 1 << 24;

/// Whether a frame needs slabs. With an order per pixel all layers must be in one list.
pub(super) fn are_needed(splats: &Splats, size: UVec2, options: &SoftOptions, pairs: u64) -> bool {
    let [width, height] = size.as_vec2().to_array();
    // More tiles than the box can touch; rounded down, as whole numbers are summed faster.
    let tiles = |lo: f32, hi: f32, most: f32| (hi.min(most) - lo.max(0.0)).max(0.0) / TILE as f32 + 2.0;
    let tiles = |b: &ScreenBox| (tiles(b.lo[0], b.hi[0], width) * tiles(b.lo[1], b.hi[1], height)) as u64;
    options.sort == Sort::Tile && splats.bounds.iter().map(tiles).sum::<u64>() > pairs
}

/// The next splats whose pairs with open tiles fit in a slab; at least one splat.
fn next(splats: &Splats, from: usize, open: &OpenTiles, pairs: u64) -> Range<usize> {
    let mut sum = 0;
    let fit = splats.bounds[from..].iter().take_while(|bounds| {
        sum += u64::from(open.count(bounds));
        sum <= pairs
    });
    from..from + fit.count().max(1)
}

/// The output of a frame, like that of [`forward::draw`] but without undrawn pairs.
pub(super) struct SlabTarget<'a> {
    pub(super) tiles: &'a mut Tiles,
    pub(super) pixels: &'a mut Vec<TilePixels>,
    pub(super) weights: &'a mut Vec<WeightSlot>,
}

impl SlabTarget<'_> {
    /// Draws all splats, at most `pairs` of splats and tiles at once. Calls `on_part` when a slab was binned
    /// and when it was drawn.
    pub(super) fn draw(
        &mut self,
        splats: &Splats,
        size: UVec2,
        options: &SoftOptions,
        counted: Option<CountedPixels<'_>>,
        pairs: u64,
    ) {
        let Self { tiles, pixels, weights } = self;
        let mut open = OpenTiles::all(size);
        let (mut kept, mut kept_weights) = (KeptPairs::default(), Vec::new());
        let mut drawn = 0;
        while drawn < splats.len() && (drawn == 0 || open.any()) {
            let some = next(splats, drawn, &open, pairs);
            let slab = if drawn == 0 { Slab::First } else { Slab::Next };
            drawn = some.end;
            tiles.bin_some(splats, some, size, options.window, Some(&open));
            forward::draw(splats, tiles, slab, pixels, weights, options, counted);
            open.close(pixels);
            kept.add(tiles, |entry| kept_weights.extend(weights.get(entry)));
        }
        forward::background(pixels, options);
        kept.add_undrawn(splats.len());
        tiles.restore(kept);
        weights.clear();
        weights.resize(kept_weights.len(), WeightSlot::default());
        for (weight, entry) in kept_weights.into_iter().zip(&tiles.entry_of_pair) {
            weights[*entry as usize] = weight;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FrameGrad, Importance, SoftOptions, SoftRasterizer, SoupGrad, SoupRef};
    use super::*;
    use glam::{Mat3, Vec2, Vec3};
    use trisplat_scene::Rng;
    use trisplat_scene::Soup;
    use trisplat_scene::camera::Camera;

    const SIZE: UVec2 = UVec2::new(150, 90);

    fn camera() -> Camera {
        let (rotation, translation) = (Mat3::IDENTITY, Vec3::ZERO);
        Camera { rotation, translation, focal: Vec2::splat(100.0), center: SIZE.as_vec2() / 2.0, size: SIZE }
    }

    /// Triangles of all sizes; the opaque ones close tiles.
    fn soup(count: usize) -> Soup {
        let mut soup = Soup::default();
        for i in 0..count as u64 {
            let rng = Rng::new(11, "slabs", i);
            let point = |k: u64| Vec3::from([0, 1, 2].map(|c| 2.0 * rng.uniform(3 * k + c) - 1.0));
            let reach = if i.is_multiple_of(5) { 4.0 } else { 0.3 };
            let center = point(0) * 1.5 + Vec3::Z * 4.0;
            soup.vertices.push([1, 2, 3].map(|k| center + reach * point(k)));
            soup.opacity.push(if i.is_multiple_of(3) { 0.98 } else { 0.3 });
            soup.sigma.push(0.05 + rng.uniform(20));
            soup.sh.push([21, 22, 23].map(|k| rng.uniform(k)));
        }
        soup
    }

    /// Everything that a frame leaves.
    fn all(soup: &Soup, options: &SoftOptions, pairs: u64) -> (SoftRasterizer, SoupGrad, Importance) {
        let (camera, soup) = (camera(), SoupRef::from(soup));
        let (mut soft, mut grad) = (SoftRasterizer::new(), SoupGrad::default());
        soft.pairs_per_slab = Some(pairs);
        soft.render(&soup, &camera, options);
        let mut importance = Importance::new(soup.len());
        soft.accumulate_importance(&mut importance);
        let pixels = (SIZE.x * SIZE.y) as usize;
        let d = FrameGrad { d_rgb: vec![[0.3, -0.2, 0.1]; pixels], ..FrameGrad::default() };
        soft.backward(&soup, &camera, options, &d, &mut grad);
        (soft, grad, importance)
    }

    #[test]
    fn slabs_change_no_bit() {
        let options = SoftOptions { importance: true, background: [0.2, 0.5, 0.9], ..SoftOptions::default() };
        for (options, count) in [
            (options, 900),
            (SoftOptions { geometry: true, ..options }, 900),
            (SoftOptions { window: super::super::Window::Coverage { width_px: 1.0 }, ..options }, 400),
            (options, 1),
        ] {
            let soup = soup(count);
            let (whole, grad, importance) = all(&soup, &options, u64::MAX);
            for pairs in [1, 100, 3000] {
                let (slabs, slab_grad, slab_importance) = all(&soup, &options, pairs);
                assert!(slabs.frame == whole.frame, "{pairs} pairs");
                assert!(slab_grad == grad, "{pairs} pairs");
                assert!(slab_importance == importance, "{pairs} pairs");
                assert!(slabs.tiles.entries.len() <= whole.tiles.entries.len());
            }
        }
    }

    #[test]
    fn what_is_hidden_takes_no_memory() {
        let mut soup = soup(1);
        let flat = |z: f32| [Vec3::new(-9.0, -9.0, z), Vec3::new(9.0, -9.0, z), Vec3::new(0.0, 18.0, z)];
        soup.vertices = (0..5000).map(|i| flat(1.0 + 0.001 * i as f32)).collect();
        (soup.opacity, soup.sigma) = (vec![0.99; 5000], vec![0.001; 5000]);
        soup.sh = vec![[0.1; 3]; 5000];
        let options = SoftOptions::default();
        let (whole, ..) = all(&soup, &options, u64::MAX);
        let (slabs, ..) = all(&soup, &options, 2000);
        let tiles = 10 * 6;
        assert_eq!(whole.tiles.entries.len(), 5000 * tiles);
        assert!(slabs.tiles.entries.len() <= 4 * tiles, "{}", slabs.tiles.entries.len());
        assert!(slabs.tiles.entries.capacity() < 10_000 && slabs.frame == whole.frame);
    }
}
