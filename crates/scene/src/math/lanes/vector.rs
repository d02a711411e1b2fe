//! The operations of SIMD values, and work that uses them.

use crate::math::real::Real;

/// Lanes in a [`Lanes`] value.
pub const LANES: usize = 16;

/// Sixteen f32.
pub trait Lanes: Real {
    /// `value` in every lane.
    fn splat(value: f32) -> Self;
    /// The sixteen numbers of an array.
    fn load(from: &[f32; LANES]) -> Self;
    /// Writes the sixteen numbers.
    fn store(self, to: &mut [f32; LANES]);
    /// Writes the sixteen numbers rounded to the nearest integers, ties to even; anything beyond ±2^31.
    fn store_rounded(self, to: &mut [i32; LANES]);
    /// One bit per lane of a mask, lane 0 lowest.
    fn bits(mask: Self::Mask) -> u16;
    /// The mask of the bits, lane 0 lowest.
    fn from_bits(bits: u16) -> Self::Mask;
    /// Sum of the lanes in a fixed order.
    fn sum(self) -> f32;
    /// Largest lane.
    fn max_lane(self) -> f32;
    /// `self` where the mask is set, else 0.
    #[inline(always)]
    fn masked(self, mask: Self::Mask) -> Self {
        Self::select(mask, self, Self::splat(0.0))
    }
    /// `self + value * factor` where the mask is set, else `self`.
    #[inline(always)]
    fn add_where(self, mask: Self::Mask, value: Self, factor: Self) -> Self {
        value.masked(mask).mul_add(factor, self)
    }
    /// Sums of the lanes of sixteen values.
    #[inline(always)]
    fn sums(values: &[Self; LANES]) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        for (out, value) in out.iter_mut().zip(values) {
            *out = value.sum();
        }
        out
    }
}

/// Work that runs on any [`Lanes`]. `run` and all it calls must be `#[inline(always)]` to be compiled for
/// each CPU level; closures and `[T; N]::map` over lanes may not be inlined, which takes ten times as long.
pub trait Work {
    /// Its result.
    type Output;
    /// Does the work.
    fn run<L: Lanes>(self) -> Self::Output;
}
