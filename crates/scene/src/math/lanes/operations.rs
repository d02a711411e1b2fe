//! The operations of SIMD values of sixteen f32, and the polynomials in them.
#![allow(clippy::excessive_precision, reason = "the digits the fit gave")]

use crate::math::real::Real;

// ---- Minimax polynomials (Remez) of the two transcendental functions the window needs -----------

/// log2(1 + t) / t on [sqrt(1/2) - 1, sqrt(2) - 1], relative error 1.7e-7 before rounding; lowest
/// first. The factor t keeps the *relative* error small near 1, where a window with a large
/// exponent needs it.
pub(in crate::math) const LOG2: [f32; 8] = [
    1.442_694_962,
    -0.721_352_788_1,
    0.480_923_242_3,
    -0.360_239_639_7,
    0.287_098_699_6,
    -0.248_876_864_5,
    0.234_042_370_6,
    -0.145_811_689_8,
];

/// 2^x on [-1/2, 1/2], relative error 7.5e-8 before rounding; lowest first.
pub(in crate::math) const EXP2: [f32; 6] = [
    1.000_000_072,
    0.693_146_967_1,
    0.240_221_197_2,
    0.055_507_132_74,
    0.009_675_541_333,
    0.001_327_647_198,
];

/// Bits of sqrt(1/2): subtracting them from a number's bits leaves the exponent of its mantissa in
/// [sqrt(1/2), sqrt(2)) in the top nine bits.
pub(in crate::math) const SQRT_HALF_BITS: i32 = 0x3f35_04f3;

// ---- The operations of SIMD values, and work that uses them -------------------------------------

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
    /// Writes the sixteen numbers rounded to the nearest integers, ties to even; anything beyond
    /// ±2^31.
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

/// Work that runs on any [`Lanes`]. `run` and all it calls must be `#[inline(always)]` to be
/// compiled for each CPU level; closures and `[T; N]::map` over lanes may not be inlined, which
/// takes ten times as long.
pub trait Work {
    /// Its result.
    type Output;
    /// Does the work.
    fn run<L: Lanes>(self) -> Self::Output;
}
