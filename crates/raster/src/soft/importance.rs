//! The importance of every triangle over many views.

use super::slots::WeightSlot;
use super::splat_sums::prefetch_ahead;
use super::splats::{CHUNK, Projection};
use super::tiles::Tiles;
use trisplat_scene::parallel;

/// Statistics of every triangle since the last reset. // each `[N]`
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Importance {
    /// Largest weight alpha · T on any pixel.
    pub max_weight: Vec<f32>,
    /// Sum of the weights over all pixels, px.
    pub sum_weight: Vec<f32>,
    /// Number of views where it was drawn on more than one pixel.
    pub views: Vec<u32>,
    /// Pixels on which it was drawn.
    pub pixels: Vec<u32>,
    /// Largest distance of a corner from the centroid on the screen, px.
    pub max_radius_px: Vec<f32>,
    /// Views accumulated.
    pub frames: u32,
}

impl Importance {
    /// Zeros for `count` triangles.
    pub fn new(count: usize) -> Self {
        let mut out = Self::default();
        out.reset(count);
        out
    }

    /// Sets everything to zero, for `count` triangles.
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

    pub(super) fn accumulate(&mut self, projection: &Projection, tiles: &Tiles, weights: &[WeightSlot]) {
        if self.max_weight.len() != projection.triangles {
            self.reset(projection.triangles);
        }
        self.frames += 1;
        if weights.len() < tiles.entries.len() {
            return;
        }
        let Self { max_weight, sum_weight, views, pixels, max_radius_px, .. } = self;
        let rows = max_weight
            .chunks_mut(CHUNK)
            .zip(sum_weight.chunks_mut(CHUNK))
            .zip(views.chunks_mut(CHUNK).zip(pixels.chunks_mut(CHUNK)))
            .zip(max_radius_px.chunks_mut(CHUNK))
            .zip(&projection.chunks);
        parallel::for_each(rows, |c, ((((max, sum), (views, pixels)), radius), chunk)| {
            let mut at = 0;
            for pieces in chunk.projected.chunk_by(|a, b| a.record.triangle == b.record.triangle) {
                let i = pieces[0].record.triangle as usize - c * CHUNK;
                let mut all = WeightSlot::default();
                for projected in pieces {
                    prefetch_ahead(tiles, &chunk.projected, at, weights);
                    at += 1;
                    all.add(&of_splat(tiles, weights, projected.rank));
                    radius[i] = radius[i].max(projected.radius_px);
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
fn of_splat(tiles: &Tiles, weights: &[WeightSlot], rank: u32) -> WeightSlot {
    let mut out = WeightSlot::default();
    for entry in tiles.entries_of_splat(rank) {
        out.add(&weights[*entry as usize]);
    }
    out
}
