//! The scalar the kernels are written for.
//!
//! One source serves f32 (production, per splat), lanes (production, per pixel), f64 (reference) and
//! dual numbers (exact derivatives, in the tests). Kernels have no branches, only [`Real::select`].

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A boolean per lane.
pub trait Mask: Copy {
    /// Lane-wise conjunction.
    fn and(self, other: Self) -> Self;
    /// Lane-wise disjunction.
    fn or(self, other: Self) -> Self;
    /// Lane-wise negation.
    fn not(self) -> Self;
}

impl Mask for bool {
    fn and(self, other: Self) -> Self {
        self & other
    }
    fn or(self, other: Self) -> Self {
        self | other
    }
    fn not(self) -> Self {
        !self
    }
}

/// A real number, or a SIMD value of several.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Result of a comparison.
    type Mask: Mask;

    /// The constant `value`, rounded, in every lane.
    fn of(value: f64) -> Self;
    /// `self * factor + term`; fused or not, whichever is faster.
    fn mul_add(self, factor: Self, term: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// 2 to the power of self; lanes are accurate on [-126, 126] only.
    fn exp2(self) -> Self;
    /// Logarithm to base 2; lanes are accurate for positive normal numbers only.
    fn log2(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The smaller of two.
    fn min(self, other: Self) -> Self;
    /// The larger of two.
    fn max(self, other: Self) -> Self;
    /// `self < other`; false with a NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`; false with a NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `yes` where the mask is set, else `no`; the other value may be anything, even a NaN.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
}

macro_rules! impl_real {
    ($t:ty) => {
        impl Real for $t {
            type Mask = bool;
            #[inline(always)]
            fn of(value: f64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn mul_add(self, factor: Self, term: Self) -> Self {
                self * factor + term
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                self.sqrt()
            }
            #[inline(always)]
            fn exp2(self) -> Self {
                self.exp2()
            }
            #[inline(always)]
            fn log2(self) -> Self {
                self.log2()
            }
            #[inline(always)]
            fn abs(self) -> Self {
                self.abs()
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn le(self, other: Self) -> bool {
                self <= other
            }
            #[inline(always)]
            fn select(mask: bool, yes: Self, no: Self) -> Self {
                if mask { yes } else { no }
            }
        }
    };
}

impl_real!(f32);
impl_real!(f64);
