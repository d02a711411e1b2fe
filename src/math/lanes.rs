//! SIMD values of sixteen f32, and the choice of the fastest such type of this CPU.
//!
//! All `unsafe` of the crate is here: vector instructions may run only where [`dispatch`] has detected them.

mod poly;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

use crate::math::real::{Mask, Real};

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

/// Prefetches `value`, which will be read soon.
#[inline(always)]
pub fn prefetch<T>(value: &T) {
    #[cfg(target_arch = "x86_64")]
    x86::prefetch(value);
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

/// Work that runs on any [`Lanes`]. `run` and all it calls must be `#[inline(always)]` to be compiled for each CPU
/// level; closures and `[T; N]::map` over lanes may not be inlined and then cost ten times their work.
pub trait Work {
    /// Its result.
    type Output;
    /// Does the work.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// Instruction sets that have their own code.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SimdLevel {
    /// What every CPU of the target has.
    Portable,
    /// AVX2 and FMA, two registers.
    Avx2,
    /// AVX-512 (F, BW, DQ, VL), one register.
    Avx512,
}

/// The best level of this CPU.
pub fn level() -> SimdLevel {
    #[cfg(target_arch = "x86_64")]
    {
        if x86::has_avx512() {
            return SimdLevel::Avx512;
        }
        if x86::has_avx2() {
            return SimdLevel::Avx2;
        }
    }
    SimdLevel::Portable
}

/// Runs `work` on the best lanes of this CPU.
#[inline]
pub fn dispatch<W: Work>(work: W) -> W::Output {
    dispatch_at(level(), work)
}

/// Runs `work` on the lanes of `wanted`, or on the best this CPU has below it.
#[inline]
pub fn dispatch_at<W: Work>(wanted: SimdLevel, work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if wanted == SimdLevel::Avx512 && x86::has_avx512() {
            return x86::run_avx512(work);
        }
        if wanted != SimdLevel::Portable && x86::has_avx2() {
            return x86::run_avx2(work);
        }
    }
    let _ = wanted;
    work.run::<portable::Portable>()
}

impl Mask for u16 {
    #[inline(always)]
    fn and(self, other: Self) -> Self {
        self & other
    }
    #[inline(always)]
    fn or(self, other: Self) -> Self {
        self | other
    }
    #[inline(always)]
    fn not(self) -> Self {
        !self
    }
}
