//! The bytes that a step moves through the card's memory, stage by stage, for comparison with the card's
//! bandwidth.

use super::job::{Count, DIGIT_BITS};
use super::uniform::StepPlan;

/// The work of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepWork {
    /// Triangles of the scene.
    pub triangles: u64,
    /// Splats: the triangles in view, those through the near plane twice.
    pub splats: u64,
    /// Pairs of splats and tiles.
    pub pairs: u64,
    /// Triangles that had a gradient.
    pub touched: u64,
    /// Samples that were drawn.
    pub frame_pixels: u64,
    /// Pixels of the photo.
    pub photo_pixels: u64,
    /// Numbers of a triangle.
    numbers: u64,
    /// Coefficients of its colour in use.
    colors: u64,
    /// Bytes of a pair's gradients.
    slot_bytes: u64,
    /// Digits of a tile's number.
    tile_digits: u64,
    /// Bytes that geometry adds to a pixel.
    geometry: u64,
    /// Bytes that depth planes add to a splat.
    planes: u64,
}

/// Digits of the largest number of a tile.
pub(super) fn tile_digits(plan: &StepPlan) -> u32 {
    let most = plan.tiles.element_product().max(2) - 1;
    (u32::BITS - most.leading_zeros()).div_ceil(DIGIT_BITS)
}

impl StepWork {
    /// Of a step that ended with `counts`, of a scene with `numbers` numbers per triangle.
    pub(super) fn new(plan: &StepPlan, counts: &[u32], triangles: u32, numbers: usize, degree: u32) -> Self {
        let count = |count: Count| u64::from(counts[count as usize]);
        let (by_pixel, geometry) = (plan.by_pixel(), plan.options.geometry);
        Self {
            triangles: triangles.into(),
            splats: count(Count::Splats),
            pairs: count(Count::Pairs),
            touched: count(Count::Touched),
            frame_pixels: plan.frame_pixels().into(),
            photo_pixels: plan.photo_pixels().into(),
            numbers: numbers as u64,
            colors: u64::from((degree + 1).pow(2)),
            slot_bytes: 4 * u64::from(plan.slot_numbers()),
            tile_digits: tile_digits(plan).into(),
            geometry: if geometry { 48 } else { 0 },
            planes: if by_pixel || geometry { 32 } else { 0 },
        }
    }

    /// Bytes that a stage reads and writes, each buffer once per pass over it. Caches reduce this number,
    /// uncoalesced accesses increase it. `None` for a stage whose work is not counted.
    pub fn bytes(&self, stage: &str) -> Option<u64> {
        let Self { triangles: n, splats: s, pairs: p, frame_pixels: f, photo_pixels: h, .. } = *self;
        // A prefix sum reads everything twice and writes it once; a digit of a sort reads keys three times, values once, and writes both.
        let (scan, digit) = (12, 24);
        Some(match stage {
            "project" => n * (2 * 44 + 4 + scan + 8) + s * (12 * self.colors + 88 + self.planes),
            "sort by depth" => s * digit * 4,
            "bin" => s * (2 * 68 + 4 + scan + 8) + p * 12,
            "sort by tile" => p * digit * self.tile_digits,
            "forward" => p * (84 + self.planes) + f * (16 + self.geometry),
            "loss" => f * 16 + h * (32 + 16 + 4 + 36 + 36 + 32 + 4 + 16),
            "geometry" => f * (2 * (16 + 48) + 32 + 32 + 32),
            "backward" => p * (84 + self.planes + self.slot_bytes) + f * (32 + self.geometry),
            "gather" => p * self.slot_bytes + s * (self.slot_bytes + 12),
            "update" => n * (36 + 8) + s * (20 + self.slot_bytes + 40) + self.touched * self.numbers * 24,
            _ => return None,
        })
    }
}
