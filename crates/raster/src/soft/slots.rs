//! The results of passes per (splat, tile) pair, in the order of the tiles' entries.

use trisplat_scene::math::lanes::LANES;

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
