//! The scalar and the vectors the kernels are written for.
//!
//! One source serves f32 (production, per splat), lanes (production, per pixel), f64 (reference)
//! and dual numbers (exact derivatives, in the tests). Kernels have no branches, only
//! [`Real::select`].

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
    Copy
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
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

// ---- Vectors of any [`Real`], for the kernels ---------------------------------------------------

/// A point or difference on the screen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct V2<R> {
    /// To the right.
    pub x: R,
    /// Down.
    pub y: R,
}

/// A point or difference in space.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct V3<R> {
    /// First coordinate.
    pub x: R,
    /// Second coordinate.
    pub y: R,
    /// Third coordinate.
    pub z: R,
}

impl<R: Real> V2<R> {
    /// (x, y).
    #[inline(always)]
    pub fn new(x: R, y: R) -> Self {
        Self { x, y }
    }
    /// Component-wise product.
    #[inline(always)]
    pub fn mul_components(self, other: Self) -> Self {
        Self { x: self.x * other.x, y: self.y * other.y }
    }
    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> R {
        self.y.mul_add(other.y, self.x * other.x)
    }
    /// Signed area of the parallelogram, x1 y2 - y1 x2.
    #[inline(always)]
    pub fn cross(self, other: Self) -> R {
        self.x * other.y - self.y * other.x
    }
    /// The perpendicular (-y, x): `a.perp().dot(b) == a.cross(b)`.
    #[inline(always)]
    pub fn perp(self) -> Self {
        Self { x: -self.y, y: self.x }
    }
}

impl<R: Real> V3<R> {
    /// (x, y, z).
    #[inline(always)]
    pub fn new(x: R, y: R, z: R) -> Self {
        Self { x, y, z }
    }
    /// Scalar product.
    #[inline(always)]
    pub fn dot(self, other: Self) -> R {
        self.z.mul_add(other.z, self.y.mul_add(other.y, self.x * other.x))
    }
    /// Vector product.
    #[inline(always)]
    pub fn cross(self, other: Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }
    /// Largest absolute component.
    #[inline(always)]
    pub fn max_abs(self) -> R {
        self.x.abs().max(self.y.abs()).max(self.z.abs())
    }
    /// The first two components.
    #[inline(always)]
    pub fn xy(self) -> V2<R> {
        V2 { x: self.x, y: self.y }
    }
}

macro_rules! component_wise {
    ($type:ident, $($c:ident),+) => {
        impl<R: Real> $type<R> {
            /// All components 0.
            #[inline(always)]
            pub fn zero() -> Self {
                Self { $($c: R::of(0.0)),+ }
            }
            /// Every component times `factor`.
            #[inline(always)]
            pub fn scale(self, factor: R) -> Self {
                Self { $($c: self.$c * factor),+ }
            }
            /// Euclidean length.
            #[inline(always)]
            pub fn length(self) -> R {
                self.dot(self).sqrt()
            }
        }

        impl<R: Real> Add for $type<R> {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                Self { $($c: self.$c + other.$c),+ }
            }
        }

        impl<R: Real> Sub for $type<R> {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                Self { $($c: self.$c - other.$c),+ }
            }
        }

        impl<R: Real> Neg for $type<R> {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self { $($c: -self.$c),+ }
            }
        }
    };
}

component_wise!(V2, x, y);
component_wise!(V3, x, y, z);
