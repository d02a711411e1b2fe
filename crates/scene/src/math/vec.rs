//! Vectors of any [`Real`], for the kernels.

use crate::math::real::Real;
use std::ops::{Add, Neg, Sub};

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
    /// (0, 0).
    #[inline(always)]
    pub fn zero() -> Self {
        Self { x: R::of(0.0), y: R::of(0.0) }
    }
    /// Every component times `factor`.
    #[inline(always)]
    pub fn scale(self, factor: R) -> Self {
        Self { x: self.x * factor, y: self.y * factor }
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
    /// Euclidean length.
    #[inline(always)]
    pub fn length(self) -> R {
        self.dot(self).sqrt()
    }
}

impl<R: Real> V3<R> {
    /// (x, y, z).
    #[inline(always)]
    pub fn new(x: R, y: R, z: R) -> Self {
        Self { x, y, z }
    }
    /// (0, 0, 0).
    #[inline(always)]
    pub fn zero() -> Self {
        Self { x: R::of(0.0), y: R::of(0.0), z: R::of(0.0) }
    }
    /// Every component times `factor`.
    #[inline(always)]
    pub fn scale(self, factor: R) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
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
    /// Euclidean length.
    #[inline(always)]
    pub fn length(self) -> R {
        self.dot(self).sqrt()
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

impl<R: Real> Add for V2<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y }
    }
}

impl<R: Real> Sub for V2<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y }
    }
}

impl<R: Real> Neg for V2<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y }
    }
}

impl<R: Real> Add for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl<R: Real> Sub for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl<R: Real> Neg for V3<R> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}
