//! Dual numbers: exact first derivatives by running the same source.

use std::ops::{Add, Div, Mul, Neg, Sub};
use trisplat_scene::math::real::Real;

/// A value and its derivatives in N directions.
#[derive(Debug, Clone, Copy)]
pub struct Dual<const N: usize> {
    pub v: f64,
    pub d: [f64; N],
}

impl<const N: usize> Dual<N> {
    pub fn constant(v: f64) -> Self {
        Self { v, d: [0.0; N] }
    }

    /// The variable of direction `i`.
    pub fn variable(v: f64, i: usize) -> Self {
        let mut out = Self::constant(v);
        out.d[i] = 1.0;
        out
    }

    fn chain(self, v: f64, slope: f64) -> Self {
        Self { v, d: self.d.map(|d| d * slope) }
    }

    fn both(self, other: Self, v: f64, a: f64, b: f64) -> Self {
        Self { v, d: std::array::from_fn(|i| self.d[i] * a + other.d[i] * b) }
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        self.both(o, self.v + o.v, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self.both(o, self.v - o.v, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        self.both(o, self.v * o.v, o.v, self.v)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        self.both(o, self.v / o.v, 1.0 / o.v, -self.v / (o.v * o.v))
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.v, -1.0)
    }
}

impl<const N: usize> Real for Dual<N> {
    type Mask = bool;
    fn of(value: f64) -> Self {
        Self::constant(value)
    }
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }
    fn sqrt(self) -> Self {
        self.chain(self.v.sqrt(), 0.5 / self.v.sqrt())
    }
    fn exp2(self) -> Self {
        self.chain(self.v.exp2(), self.v.exp2() * std::f64::consts::LN_2)
    }
    fn log2(self) -> Self {
        self.chain(self.v.log2(), 1.0 / (self.v * std::f64::consts::LN_2))
    }
    fn abs(self) -> Self {
        self.chain(self.v.abs(), if self.v < 0.0 { -1.0 } else { 1.0 })
    }
    fn min(self, o: Self) -> Self {
        if self.v < o.v { self } else { o }
    }
    fn max(self, o: Self) -> Self {
        if self.v > o.v { self } else { o }
    }
    fn lt(self, o: Self) -> bool {
        self.v < o.v
    }
    fn le(self, o: Self) -> bool {
        self.v <= o.v
    }
    fn select(mask: bool, yes: Self, no: Self) -> Self {
        if mask { yes } else { no }
    }
}
