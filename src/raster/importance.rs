//! How much every triangle matters, over many views.

use crate::raster::project::{CHUNK, Projection};
use crate::raster::tiles::Tiles;
use rayon::prelude::*;

/// Statistics of every triangle since the last reset. // each `[N]`
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
        let Self { max_weight, sum_weight, views, pixels, max_radius_px, .. } = self;
        max_weight
            .par_chunks_mut(CHUNK)
            .zip(sum_weight.par_chunks_mut(CHUNK))
            .zip(views.par_chunks_mut(CHUNK).zip(pixels.par_chunks_mut(CHUNK)))
            .zip(max_radius_px.par_chunks_mut(CHUNK))
            .zip(&projection.chunks)
            .enumerate()
            .for_each(|(c, ((((max, sum), (views, pixels)), radius), chunk))| {
                for pieces in chunk.seen.chunk_by(|a, b| a.record.triangle == b.record.triangle) {
                    let i = pieces[0].record.triangle as usize - c * CHUNK;
                    let mut all = SlotWeight::default();
                    for seen in pieces {
                        all.add(&of_splat(tiles, weights, seen.place as usize));
                        radius[i] = radius[i].max(seen.radius_px);
                    }
                    max[i] = max[i].max(all.max);
                    sum[i] += all.sum;
                    pixels[i] += all.pixels;
                    views[i] += u32::from(all.pixels > 1);
                }
            });
    }
}

/// Weights of a splat in all tiles.
fn of_splat(tiles: &Tiles, weights: &[SlotWeight], place: usize) -> SlotWeight {
    let mut out = SlotWeight::default();
    for entry in &tiles.entry_of_pair[tiles.pairs[place] as usize..tiles.pairs[place + 1] as usize] {
        out.add(&weights[*entry as usize]);
    }
    out
}
