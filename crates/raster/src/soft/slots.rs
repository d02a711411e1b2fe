//! Results of the passes per (splat, tile) pair, and their sums over tiles and views in a fixed
//! order: gradients, and the importance of triangles.

use super::projected::{CHUNK, ProjectedScene, ProjectedSplat};
use super::tiles::{self, Tiles};
use glam::UVec2;
use trisplat_scene::math::lanes::{LANES, prefetch};
use trisplat_scene::parallel;

/// Gradients of a splat summed over the pixels of a tile; the constants name the entries.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(super) struct GradSlot(pub(super) [f32; LANES]);

/// The same for depth and normal: ∂L/∂(1/z), that times p - origin (2), ∂L/∂normal (3).
pub(super) type GeometryGradSlot = [f32; GEOMETRY_SUMS];

/// ∂L/∂rgb at 0, 1, 2.
pub(super) const RGB: usize = 0;
/// ∂L/∂o · o.
pub(super) const OPACITY: usize = 3;
/// ∂L/∂σ.
pub(super) const SIGMA: usize = 4;
/// ∂L/∂ratio of edge i, at 3 i; then that times p - origin.
pub(super) const RATIO: usize = 5;
/// 1 when the splat was drawn in the tile, else 0.
pub(super) const DRAWN: usize = 14;
/// Σ w error.
pub(super) const ERROR: usize = 15;
/// Entries of a [`GeometryGradSlot`].
pub(super) const GEOMETRY_SUMS: usize = 6;

/// Weights of a splat in a tile.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct WeightSlot {
    pub(super) max: f32,
    pub(super) sum: f32,
    pub(super) pixels: u32,
}

impl WeightSlot {
    /// Adds the weights on other pixels of the tile.
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        self.max = self.max.max(other.max);
        self.sum += other.sum;
        self.pixels += other.pixels;
    }
}

/// The gradients of all pairs.
#[derive(Debug, Default)]
pub(super) struct GradSlots {
    pub(super) base: Vec<GradSlot>,
    /// Empty when there is no geometry.
    pub(super) geometry: Vec<GeometryGradSlot>,
}

/// Slots are prefetched this many splats ahead.
const SLOTS_AHEAD: usize = 8;

/// The gradients of all pairs of a splat, summed.
#[derive(Clone, Copy)]
pub(super) struct SplatSums {
    pub(super) base: [f32; LANES],
    pub(super) geometry: [f32; GEOMETRY_SUMS],
}

/// Prefetches the `values` of the pairs of a splat soon after `i`, and the list of pairs of a later
/// one.
#[inline]
pub(super) fn prefetch_ahead<T>(
    tiles: &Tiles,
    projected: &[ProjectedSplat],
    i: usize,
    values: &[T],
) {
    if let Some(ahead) = projected.get(i + SLOTS_AHEAD) {
        for entry in tiles.entries_of_splat(ahead.rank) {
            prefetch(&values[*entry as usize]);
        }
    }
    if let Some(ahead) = projected.get(i + 3 * SLOTS_AHEAD)
        && let Some(entry) = tiles.entries_of_splat(ahead.rank).first()
    {
        prefetch(entry);
    }
}

impl SplatSums {
    /// The sums of every splat of a chunk. In a separate loop, so that its many scattered reads
    /// overlap.
    pub(super) fn of_chunk(
        tiles: &Tiles,
        slots: &GradSlots,
        projected: &[ProjectedSplat],
        geometry: bool,
    ) -> Vec<Self> {
        let mut out = Vec::with_capacity(projected.len());
        for (i, s) in projected.iter().enumerate() {
            prefetch_ahead(tiles, projected, i, &slots.base);
            out.push(Self::of(slots, tiles.entries_of_splat(s.rank), geometry));
        }
        out
    }

    #[inline]
    fn of(slots: &GradSlots, entries: &[u32], geometry: bool) -> Self {
        let mut out = Self { base: [0.0; LANES], geometry: [0.0; GEOMETRY_SUMS] };
        for entry in entries {
            let slot = &slots.base[*entry as usize].0;
            for (sum, value) in out.base.iter_mut().zip(slot) {
                *sum += value;
            }
            if geometry && slot[DRAWN] > 0.0 {
                for (sum, value) in out.geometry.iter_mut().zip(&slots.geometry[*entry as usize]) {
                    *sum += value;
                }
            }
        }
        out
    }

    /// True if the splat was drawn.
    pub(super) fn is_drawn(&self) -> bool {
        self.base[DRAWN] > 0.0
    }
}

/// The pixels of a photo that count for the importance of triangles. A training ignores the others,
/// so their colours are compared with nothing.
#[derive(Debug, Clone, Copy)]
pub struct CountedPixels<'a> {
    /// 0: does not count. `[H * W]` of the photo
    pub alpha: &'a [u8],
    /// Width of the photo, px.
    pub width: u32,
}

impl CountedPixels<'_> {
    /// One bit for each counted pixel of a block of a tile; pixels outside the photo do not count.
    pub(super) fn block(&self, corner: UVec2, block: usize) -> u16 {
        let counts = |lane: usize| {
            let (x, y) = tiles::pixel(corner, block, lane);
            x < self.width
                && self.alpha.get((y * self.width + x) as usize).is_some_and(|&alpha| alpha > 0)
        };
        (0..LANES).map(|lane| u16::from(counts(lane)) << lane).sum()
    }
}

/// Statistics of every triangle over all views so far, over the pixels that count. // each `[N]`
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
    /// Reciprocal of its least depth in a view that drew it on more than one pixel; 0 without such
    /// a view.
    pub nearness: Vec<f32>,
}

impl Importance {
    /// Zeros for `count` triangles.
    pub fn new(count: usize) -> Self {
        Self {
            max_weight: vec![0.0; count],
            sum_weight: vec![0.0; count],
            views: vec![0; count],
            pixels: vec![0; count],
            max_radius_px: vec![0.0; count],
            nearness: vec![0.0; count],
        }
    }

    pub(super) fn accumulate(
        &mut self,
        projection: &ProjectedScene,
        tiles: &Tiles,
        weights: &[WeightSlot],
    ) {
        if self.max_weight.len() != projection.triangles {
            *self = Self::new(projection.triangles);
        }
        if weights.len() < tiles.entries.len() {
            return;
        }
        let Self { max_weight, sum_weight, views, pixels, max_radius_px, nearness } = self;
        let rows = max_weight
            .chunks_mut(CHUNK)
            .zip(sum_weight.chunks_mut(CHUNK))
            .zip(views.chunks_mut(CHUNK).zip(pixels.chunks_mut(CHUNK)))
            .zip(max_radius_px.chunks_mut(CHUNK).zip(nearness.chunks_mut(CHUNK)))
            .zip(&projection.chunks);
        parallel::for_each(
            rows,
            |c, ((((max, sum), (views, pixels)), (radius, nearness)), chunk)| {
                let mut at = 0;
                for pieces in
                    chunk.projected.chunk_by(|a, b| a.record.triangle == b.record.triangle)
                {
                    let i = pieces[0].record.triangle as usize - c * CHUNK;
                    let mut all = WeightSlot::default();
                    let mut near = 0.0f32;
                    for projected in pieces {
                        prefetch_ahead(tiles, &chunk.projected, at, weights);
                        let piece = of_splat(tiles, weights, projected.rank);
                        if piece.pixels > 0 {
                            near = near.max(f32::from_bits(chunk.depths[at]).recip());
                        }
                        at += 1;
                        all.add(&piece);
                        radius[i] = radius[i].max(projected.radius_px);
                    }
                    max[i] = max[i].max(all.max);
                    sum[i] += all.sum;
                    pixels[i] += all.pixels;
                    if all.pixels > 1 {
                        views[i] += 1;
                        nearness[i] = nearness[i].max(near);
                    }
                }
            },
        );
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

#[cfg(test)]
mod tests {
    use super::super::{SoftOptions, SoftRasterizer, Sort, SoupRef};
    use super::*;
    use glam::{Mat3, Vec2, Vec3};
    use trisplat_scene::{Soup, camera::Camera};

    const PHOTO: UVec2 = UVec2::new(37, 21);

    /// Triangles of about 8 photo pixels, one beside the other in front of the camera; every second
    /// is soft.
    fn soup() -> Soup {
        let mut soup = Soup::default();
        for i in 0..9u8 {
            let center = Vec3::new(-1.6 + 0.4 * f32::from(i), 0.1, 4.0 + 0.1 * f32::from(i));
            soup.vertices.push(
                [[-0.4, -0.3], [0.4, -0.3], [0.0, 0.5]].map(|[x, y]| center + Vec3::new(x, y, 0.0)),
            );
            soup.opacity.push(0.6);
            soup.sigma.push(if i % 2 == 0 { 0.1 } else { 1.5 });
            soup.sh.push([0.4; 3]);
        }
        soup
    }

    /// The importance of every triangle, summed over one drawing with each of the masks.
    fn importance(sort: Sort, masks: &[Option<&[u8]>]) -> Importance {
        let soup = soup();
        let size = PHOTO;
        let focal = Vec2::splat(40.0);
        let rotation = Mat3::IDENTITY;
        let translation = Vec3::ZERO;
        let camera = Camera { rotation, translation, focal, center: size.as_vec2() / 2.0, size };
        let options = SoftOptions { importance: true, sort, ..SoftOptions::default() };
        let mut soft = SoftRasterizer::new();
        let mut out = Importance::new(soup.len());
        for mask in masks {
            let counted = mask.map(|alpha| CountedPixels { alpha, width: PHOTO.x });
            soft.render_counting(&SoupRef::from(&soup), &camera, &options, counted);
            soft.accumulate_importance(&mut out);
        }
        out
    }

    /// For every pixel that `alpha` counts, a mask of that pixel alone.
    fn single_pixels(alpha: &[u8]) -> Vec<Vec<u8>> {
        let alone = |at: usize| (0..alpha.len()).map(|i| u8::from(i == at)).collect();
        (0..alpha.len()).filter(|at| alpha[*at] > 0).map(alone).collect()
    }

    #[test]
    fn only_counted_pixels_add_to_the_importance() {
        let pixels = PHOTO.element_product() as usize;
        let left: Vec<u8> = (0..pixels).map(|i| u8::from(i % (PHOTO.x as usize) < 14)).collect();
        for sort in [Sort::Tile, Sort::Pixel] {
            let once = importance(sort, &[Some(&left)]);
            let pixels = single_pixels(&left);
            let masks: Vec<_> = pixels.iter().map(|mask| Some(mask.as_slice())).collect();
            let singly = importance(sort, &masks);
            assert_eq!(once.max_weight, singly.max_weight);
            assert_eq!(once.pixels, singly.pixels);
            let close = |(a, b): (&f32, &f32)| (a - b).abs() <= 1e-5 * b.max(1.0);
            assert!(
                once.sum_weight.iter().zip(&singly.sum_weight).all(close),
                "{once:?} is not {singly:?}"
            );
            // The last triangles are in the right half only: drawn, but shown by no pixel that
            // counts.
            assert!(once.max_weight[0] > 0.5 && once.views[0] == 1);
            let last = soup().len() - 1;
            assert_eq!(
                (once.max_weight[last], once.sum_weight[last], once.views[last]),
                (0.0, 0.0, 0)
            );
        }
    }

    #[test]
    fn without_a_mask_every_pixel_counts() {
        let alpha = vec![1; PHOTO.element_product() as usize];
        let [all, none] =
            [Some(alpha.as_slice()), None].map(|mask| importance(Sort::Tile, &[mask]));
        assert_eq!(all, none);
        assert!(all.max_weight.iter().all(|weight| *weight > 0.3));
    }
}
