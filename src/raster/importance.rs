//! How much every triangle matters, over many views.

use crate::raster::project::Projection;
use crate::raster::tiles::Tiles;

/// Statistics of every triangle since the last reset. // each [N]
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Importance {
    /// Largest weight alpha · T on any pixel.
    pub max_weight: Vec<f32>,
    /// Sum of the weights over all pixels, px.
    pub sum_weight: Vec<f32>,
    /// Views in which it was drawn on more than one pixel.
    pub views: Vec<u32>,
    /// Pixels on which it was drawn.
    pub pixels: Vec<u32>,
    /// Largest distance of a corner from the centroid on the screen, px.
    pub max_radius_px: Vec<f32>,
    /// Views accumulated.
    pub frames: u32,
}

/// Weights of a splat in a tile.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SlotWeight {
    pub(super) max: f32,
    pub(super) sum: f32,
    pub(super) pixels: u32,
}

impl SlotWeight {
    /// Joins the weights on other pixels of the tile.
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        self.max = self.max.max(other.max);
        self.sum += other.sum;
        self.pixels += other.pixels;
    }
}

impl Importance {
    /// Nothing seen yet, for `count` triangles.
    pub fn new(count: usize) -> Self {
        let mut out = Self::default();
        out.reset(count);
        out
    }

    /// Forgets everything and makes room for `count` triangles.
    pub fn reset(&mut self, count: usize) {
        for values in [&mut self.max_weight, &mut self.sum_weight, &mut self.max_radius_px] {
            values.clear();
            values.resize(count, 0.0);
        }
        for values in [&mut self.views, &mut self.pixels] {
            values.clear();
            values.resize(count, 0);
        }
        self.frames = 0;
    }

    pub(super) fn accumulate(&mut self, projection: &Projection, tiles: &Tiles, weights: &[SlotWeight]) {
        if self.max_weight.len() != projection.triangles {
            self.reset(projection.triangles);
        }
        self.frames += 1;
        if weights.len() < tiles.entries.len() {
            return;
        }
        for chunk in &projection.chunks {
            let mut before = (u32::MAX, 0);
            for seen in &chunk.seen {
                let t = seen.record.triangle;
                let place = seen.place as usize;
                let mut pixels = if before.0 == t { before.1 } else { 0 };
                let earlier = pixels;
                for pair in tiles.pairs[place]..tiles.pairs[place + 1] {
                    let weight = weights[tiles.entry_of_pair[pair as usize] as usize];
                    let largest = &mut self.max_weight[t as usize];
                    *largest = largest.max(weight.max);
                    self.sum_weight[t as usize] += weight.sum;
                    pixels += weight.pixels;
                }
                let radius = &mut self.max_radius_px[t as usize];
                *radius = radius.max(seen.radius_px);
                self.pixels[t as usize] += pixels - earlier;
                // Two pieces of one cut triangle are one view.
                self.views[t as usize] += u32::from(pixels > 1 && earlier <= 1);
                before = (t, pixels);
            }
        }
    }
}
