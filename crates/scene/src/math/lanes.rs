//! SIMD values of sixteen f32, and the choice of the fastest such type of this CPU.
//!
//! Vector instructions are `unsafe` (`x86.rs`): they may run only where [`dispatch`] has detected
//! them. The crate has `unsafe` code in two other places: calls of the system (`process`), and
//! vectors that threads fill together (`parallel`).

use super::real::Mask;
use std::cell::Cell;

mod operations;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(in crate::math) use operations::{EXP2, LOG2, SQRT_HALF_BITS};
pub use operations::{LANES, Lanes, Work};

/// Prefetches `value`, which will be read soon.
#[inline(always)]
pub fn prefetch<T>(value: &T) {
    #[cfg(target_arch = "x86_64")]
    x86::prefetch(value);
    #[cfg(not(target_arch = "x86_64"))]
    let _ = value;
}

/// Instruction sets that have their own code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum SimdLevel {
    /// The instructions of every CPU of the target.
    Portable,
    /// AVX2 and FMA, two registers.
    Avx2,
    /// AVX-512 (F, BW, DQ, VL), one register.
    Avx512,
}

thread_local! {
    /// The highest level that this thread may use.
    static LEVEL_LIMIT: Cell<SimdLevel> = const { Cell::new(SimdLevel::Avx512) };
}

/// Runs `work` with [`level`] at most `limit`, to compare instruction sets. This affects only this
/// thread, not those of a pool.
pub fn with_at_most<T>(limit: SimdLevel, work: impl FnOnce() -> T) -> T {
    let before = LEVEL_LIMIT.replace(limit);
    let out = work();
    LEVEL_LIMIT.set(before);
    out
}

/// The best level of this CPU.
pub fn level() -> SimdLevel {
    LEVEL_LIMIT.get().min(best())
}

fn best() -> SimdLevel {
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

/// Runs `work` on the lanes of `level`, or on the next lower level of this CPU.
#[inline]
pub fn dispatch_at<W: Work>(level: SimdLevel, work: W) -> W::Output {
    #[cfg(target_arch = "x86_64")]
    {
        if level == SimdLevel::Avx512 && x86::has_avx512() {
            return x86::run_avx512(work);
        }
        if level != SimdLevel::Portable && x86::has_avx2() {
            return x86::run_avx2(work);
        }
    }
    let _ = level;
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
