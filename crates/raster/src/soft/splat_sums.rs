//! The gradients of a splat, summed over its tiles in a fixed order.

use super::slots::{DRAWN, GEOMETRY_SUMS, GradSlots};
use super::splats::ProjectedSplat;
use super::tiles::Tiles;
use trisplat_scene::math::lanes::{LANES, prefetch};

/// Slots are prefetched this many splats ahead.
const SLOTS_AHEAD: usize = 8;

/// The gradients of all pairs of a splat, summed.
#[derive(Clone, Copy)]
pub(super) struct SplatSums {
    pub(super) base: [f32; LANES],
    pub(super) geometry: [f32; GEOMETRY_SUMS],
}

/// Prefetches the `values` of the pairs of a splat soon after `i`, and the list of pairs of a later one.
#[inline]
pub(super) fn prefetch_ahead<T>(tiles: &Tiles, projected: &[ProjectedSplat], i: usize, values: &[T]) {
    if let Some(ahead) = projected.get(i + SLOTS_AHEAD) {
        tiles.entries_of_splat(ahead.rank).iter().for_each(|entry| prefetch(&values[*entry as usize]));
    }
    if let Some(ahead) = projected.get(i + 3 * SLOTS_AHEAD) {
        tiles.entries_of_splat(ahead.rank).first().into_iter().for_each(prefetch);
    }
}

impl SplatSums {
    /// The sums of every splat of a chunk. In a separate loop, so that its many scattered reads overlap.
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

    /// Whether the splat was drawn at all.
    pub(super) fn drawn(&self) -> bool {
        self.base[DRAWN] > 0.0
    }
}
