//! Lanes as a plain array: the compiler vectorises the loops for the target.
#![allow(clippy::needless_range_loop, reason = "the plain form is the one that is vectorised")]

use super::operations::{EXP2, LANES, LOG2, Lanes, SQRT_HALF_BITS};
use crate::math::real::Real;
use std::ops::{Add, Div, Mul, Neg, Sub};

#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(super) struct Portable([f32; LANES]);

#[inline(always)]
fn map(a: Portable, f: impl Fn(f32) -> f32) -> Portable {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = f(a.0[i]);
    }
    Portable(out)
}

#[inline(always)]
fn zip(a: Portable, b: Portable, f: impl Fn(f32, f32) -> f32) -> Portable {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = f(a.0[i], b.0[i]);
    }
    Portable(out)
}

#[inline(always)]
fn compare(a: Portable, b: Portable, f: impl Fn(f32, f32) -> bool) -> u16 {
    let mut out = 0;
    for i in 0..LANES {
        out |= u16::from(f(a.0[i], b.0[i])) << i;
    }
    out
}

macro_rules! operator {
    ($trait:ident, $method:ident, $op:tt) => {
        impl $trait for Portable {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                zip(self, other, |a, b| a $op b)
            }
        }
    };
}
operator!(Add, add, +);
operator!(Sub, sub, -);
operator!(Mul, mul, *);
operator!(Div, div, /);

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        map(self, |a| -a)
    }
}

#[inline(always)]
fn log2(x: f32) -> f32 {
    let bits = x.to_bits() as i32;
    let exponent = bits.wrapping_sub(SQRT_HALF_BITS) >> 23;
    let t = f32::from_bits(bits.wrapping_sub(exponent << 23) as u32) - 1.0;
    let mut p = LOG2[7];
    for c in LOG2[..7].iter().rev() {
        p = p * t + c;
    }
    p * t + exponent as f32
}

#[inline(always)]
fn exp2(x: f32) -> f32 {
    // Adding and subtracting 1.5 * 2^23 rounds to the nearest integer.
    const ROUND: f32 = 12_582_912.0;
    let whole = x + ROUND;
    let f = x - (whole - ROUND);
    let mut p = EXP2[5];
    for c in EXP2[..5].iter().rev() {
        p = p * f + c;
    }
    f32::from_bits(p.to_bits().wrapping_add(whole.to_bits() << 23))
}

impl Real for Portable {
    type Mask = u16;
    #[inline(always)]
    fn of(value: f64) -> Self {
        Self([value as f32; LANES])
    }
    #[inline(always)]
    fn mul_add(self, factor: Self, term: Self) -> Self {
        self * factor + term
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        map(self, f32::sqrt)
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        map(self, exp2)
    }
    #[inline(always)]
    fn log2(self) -> Self {
        map(self, log2)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        map(self, f32::abs)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        zip(self, other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        zip(self, other, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn lt(self, other: Self) -> u16 {
        compare(self, other, |a, b| a < b)
    }
    #[inline(always)]
    fn le(self, other: Self) -> u16 {
        compare(self, other, |a, b| a <= b)
    }
    #[inline(always)]
    fn select(mask: u16, yes: Self, no: Self) -> Self {
        let mut out = no.0;
        for i in 0..LANES {
            out[i] = if mask >> i & 1 == 1 { yes.0[i] } else { no.0[i] };
        }
        Self(out)
    }
}

impl Lanes for Portable {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        Self([value; LANES])
    }
    #[inline(always)]
    fn load(from: &[f32; LANES]) -> Self {
        Self(*from)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; LANES]) {
        *to = self.0;
    }
    #[inline(always)]
    fn store_rounded(self, to: &mut [i32; LANES]) {
        for (to, x) in to.iter_mut().zip(self.0) {
            *to = x.round_ties_even() as i32;
        }
    }
    #[inline(always)]
    fn bits(mask: u16) -> u16 {
        mask
    }
    #[inline(always)]
    fn from_bits(bits: u16) -> u16 {
        bits
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        let mut v = self.0;
        let mut half = LANES / 2;
        while half > 0 {
            for i in 0..half {
                v[i] += v[i + half];
            }
            half /= 2;
        }
        v[0]
    }
    #[inline(always)]
    fn max_lane(self) -> f32 {
        self.0.iter().copied().fold(f32::NEG_INFINITY, f32::max)
    }
}
