//! Lanes as AVX-512 or AVX2 registers.
#![allow(unsafe_code)]

use super::operations::{EXP2, LANES, LOG2, Lanes, SQRT_HALF_BITS, Work};
use crate::math::real::{Mask, Real};
use std::arch::x86_64::*;
use std::ops::{Add, Div, Mul, Neg, Sub};
use std::sync::LazyLock;

pub(super) fn has_avx512() -> bool {
    static HAS: LazyLock<bool> = LazyLock::new(|| {
        is_x86_feature_detected!("avx512f")
            && is_x86_feature_detected!("avx512bw")
            && is_x86_feature_detected!("avx512dq")
            && is_x86_feature_detected!("avx512vl")
            && has_avx2()
    });
    *HAS
}

pub(super) fn has_avx2() -> bool {
    static HAS: LazyLock<bool> =
        LazyLock::new(|| is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"));
    *HAS
}

#[inline(always)]
pub(super) fn prefetch<T>(value: &T) {
    // SAFETY: SSE is part of x86-64, and a prefetch has no effect but on speed.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(value).cast()) }
}

/// Runs `work` on AVX-512 lanes; only where [`has_avx512`] is true.
pub(super) fn run_avx512<W: Work>(work: W) -> W::Output {
    #[target_feature(enable = "avx512f,avx512bw,avx512dq,avx512vl,avx2,fma")]
    fn enter<W: Work>(work: W) -> W::Output {
        work.run::<Avx512>()
    }
    assert!(has_avx512());
    // SAFETY: the features were just detected.
    unsafe { enter(work) }
}

/// Runs `work` on AVX2 lanes; only where [`has_avx2`] is true.
pub(super) fn run_avx2<W: Work>(work: W) -> W::Output {
    #[target_feature(enable = "avx2,fma")]
    fn enter<W: Work>(work: W) -> W::Output {
        work.run::<Avx2>()
    }
    assert!(has_avx2());
    // SAFETY: the features were just detected.
    unsafe { enter(work) }
}

// SAFETY of every block below: the two types are private to this module and are named only in
// `run_avx512` and `run_avx2`, so no value and no operation of theirs exists on a CPU without the
// features.

#[derive(Clone, Copy)]
struct Avx512(__m512);

/// A method of one to three values, by an intrinsic of each of their registers.
macro_rules! lanewise {
    ($method:ident(self), $intrinsic:ident, $($register:tt),+) => {
        #[inline(always)]
        fn $method(self) -> Self {
            // SAFETY: see the top of this section.
            unsafe { Self($($intrinsic(self.$register)),+) }
        }
    };
    ($method:ident(self, $b:ident), $intrinsic:ident, $($register:tt),+) => {
        #[inline(always)]
        fn $method(self, $b: Self) -> Self {
            // SAFETY: see the top of this section.
            unsafe { Self($($intrinsic(self.$register, $b.$register)),+) }
        }
    };
    ($method:ident(self, $b:ident, $c:ident), $intrinsic:ident, $($register:tt),+) => {
        #[inline(always)]
        fn $method(self, $b: Self, $c: Self) -> Self {
            // SAFETY: see the top of this section.
            unsafe { Self($($intrinsic(self.$register, $b.$register, $c.$register)),+) }
        }
    };
}

macro_rules! operator {
    ($type:ident, $trait:ident, $method:ident, $intrinsic:ident, $($register:tt),+) => {
        impl $trait for $type {
            type Output = Self;
            lanewise!($method(self, other), $intrinsic, $($register),+);
        }
    };
}
operator!(Avx512, Add, add, _mm512_add_ps, 0);
operator!(Avx512, Sub, sub, _mm512_sub_ps, 0);
operator!(Avx512, Mul, mul, _mm512_mul_ps, 0);
operator!(Avx512, Div, div, _mm512_div_ps, 0);
operator!(Avx2, Add, add, _mm256_add_ps, 0, 1);
operator!(Avx2, Sub, sub, _mm256_sub_ps, 0, 1);
operator!(Avx2, Mul, mul, _mm256_mul_ps, 0, 1);
operator!(Avx2, Div, div, _mm256_div_ps, 0, 1);

impl Neg for Avx512 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: see the top of this section.
        Self(unsafe { _mm512_xor_ps(self.0, _mm512_set1_ps(-0.0)) })
    }
}

impl Real for Avx512 {
    type Mask = u16;
    #[inline(always)]
    fn of(value: f64) -> Self {
        Self::splat(value as f32)
    }
    lanewise!(mul_add(self, factor, term), _mm512_fmadd_ps, 0);
    lanewise!(sqrt(self), _mm512_sqrt_ps, 0);
    #[inline(always)]
    fn exp2(self) -> Self {
        // SAFETY: see the top of this section.
        unsafe {
            let round = Self::splat(12_582_912.0);
            let whole = self + round;
            let f = self - (whole - round);
            let p = horner(&EXP2, f);
            let scale = _mm512_slli_epi32::<23>(_mm512_castps_si512(whole.0));
            Self(_mm512_castsi512_ps(_mm512_add_epi32(_mm512_castps_si512(p.0), scale)))
        }
    }
    #[inline(always)]
    fn log2(self) -> Self {
        // SAFETY: see the top of this section.
        unsafe {
            let bits = _mm512_castps_si512(self.0);
            let exponent =
                _mm512_srai_epi32::<23>(_mm512_sub_epi32(bits, _mm512_set1_epi32(SQRT_HALF_BITS)));
            let mantissa =
                _mm512_castsi512_ps(_mm512_sub_epi32(bits, _mm512_slli_epi32::<23>(exponent)));
            let t = Self(mantissa) - Self::splat(1.0);
            horner(&LOG2, t).mul_add(t, Self(_mm512_cvtepi32_ps(exponent)))
        }
    }
    lanewise!(abs(self), _mm512_abs_ps, 0);
    lanewise!(min(self, other), _mm512_min_ps, 0);
    lanewise!(max(self, other), _mm512_max_ps, 0);
    #[inline(always)]
    fn lt(self, other: Self) -> u16 {
        // SAFETY: see the top of this section.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LT_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn le(self, other: Self) -> u16 {
        // SAFETY: see the top of this section.
        unsafe { _mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, other.0) }
    }
    #[inline(always)]
    fn select(mask: u16, yes: Self, no: Self) -> Self {
        // SAFETY: see the top of this section.
        Self(unsafe { _mm512_mask_blend_ps(mask, no.0, yes.0) })
    }
}

/// Polynomial with `coefficients`, lowest first.
#[inline(always)]
fn horner<L: Lanes>(coefficients: &[f32], x: L) -> L {
    let (last, rest) = coefficients.split_last().map_or((0.0, &[][..]), |(l, r)| (*l, r));
    let mut p = L::splat(last);
    for c in rest.iter().rev() {
        p = p.mul_add(x, L::splat(*c));
    }
    p
}

impl Lanes for Avx512 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see the top of this section.
        Self(unsafe { _mm512_set1_ps(value) })
    }
    #[inline(always)]
    fn load(from: &[f32; LANES]) -> Self {
        // SAFETY: see the top of this section; the array holds sixteen floats.
        Self(unsafe { _mm512_loadu_ps(from.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; LANES]) {
        // SAFETY: see the top of this section; the array holds sixteen floats.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn store_rounded(self, to: &mut [i32; LANES]) {
        // SAFETY: see the top of this section; the array holds sixteen integers.
        unsafe { _mm512_storeu_si512(to.as_mut_ptr().cast(), _mm512_cvtps_epi32(self.0)) }
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
        // SAFETY: see the top of this section.
        unsafe { _mm512_reduce_add_ps(self.0) }
    }
    #[inline(always)]
    fn max_lane(self) -> f32 {
        // SAFETY: see the top of this section.
        unsafe { _mm512_reduce_max_ps(self.0) }
    }
    #[inline(always)]
    fn masked(self, mask: u16) -> Self {
        // SAFETY: see the top of this section.
        Self(unsafe { _mm512_maskz_mov_ps(mask, self.0) })
    }
    #[inline(always)]
    fn add_where(self, mask: u16, value: Self, factor: Self) -> Self {
        // SAFETY: see the top of this section.
        Self(unsafe { _mm512_mask3_fmadd_ps(value.0, factor.0, self.0, mask) })
    }
    #[inline(always)]
    fn sums(values: &[Self; LANES]) -> [f32; LANES] {
        // SAFETY: see the top of this section.
        unsafe { sums512(values) }
    }
}

/// Sums of sixteen registers by folding pairs: 15 adds and 30 shuffles for all of them.
#[inline(always)]
unsafe fn sums512(v: &[Avx512; LANES]) -> [f32; LANES] {
    // SAFETY: as for the operations of the type.
    unsafe {
        let z = _mm512_setzero_ps();
        // Halves of 256 bits: a of eight holds v[i] low and v[i + 8] high.
        let mut a = [z; 8];
        for i in 0..8 {
            let p = v[i].0;
            let q = v[i + 8].0;
            a[i] = _mm512_add_ps(
                _mm512_shuffle_f32x4::<0x44>(p, q),
                _mm512_shuffle_f32x4::<0xee>(p, q),
            );
        }
        // Quarters of 128 bits: b[i] holds v[i], v[i + 4], v[i + 8], v[i + 12].
        let mut b = [z; 4];
        for i in 0..4 {
            let p = a[i];
            let q = a[i + 4];
            b[i] = _mm512_add_ps(
                _mm512_shuffle_f32x4::<0x88>(p, q),
                _mm512_shuffle_f32x4::<0xdd>(p, q),
            );
        }
        // b[i] quarters: v[i], v[i + 8], v[i + 4], v[i + 12].
        let mut c = [z; 2];
        for i in 0..2 {
            let p = b[i];
            let q = b[i + 2];
            c[i] = _mm512_add_ps(_mm512_unpacklo_ps(p, q), _mm512_unpackhi_ps(p, q));
        }
        let d = _mm512_add_ps(_mm512_unpacklo_ps(c[0], c[1]), _mm512_unpackhi_ps(c[0], c[1]));
        let mut lanes = [0.0f32; LANES];
        _mm512_storeu_ps(lanes.as_mut_ptr(), d);
        let mut out = [0.0f32; LANES];
        // Quarter q of d holds rows ORDER[q] + 0, 1, 2, 3.
        for (quarter, row) in [0usize, 8, 4, 12].into_iter().enumerate() {
            for i in 0..4 {
                out[row + i] = lanes[quarter * 4 + i];
            }
        }
        out
    }
}

#[derive(Clone, Copy)]
struct Avx2(__m256, __m256);

#[derive(Clone, Copy)]
struct Mask2(__m256, __m256);

impl Mask for Mask2 {
    lanewise!(and(self, other), _mm256_and_ps, 0, 1);
    lanewise!(or(self, other), _mm256_or_ps, 0, 1);
    #[inline(always)]
    fn not(self) -> Self {
        // SAFETY: see the top of this section.
        unsafe {
            let ones = _mm256_castsi256_ps(_mm256_set1_epi32(-1));
            Self(_mm256_xor_ps(self.0, ones), _mm256_xor_ps(self.1, ones))
        }
    }
}

impl Neg for Avx2 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        // SAFETY: see the top of this section.
        unsafe {
            let sign = _mm256_set1_ps(-0.0);
            Self(_mm256_xor_ps(self.0, sign), _mm256_xor_ps(self.1, sign))
        }
    }
}

/// Applies a function of one half to both.
macro_rules! halves {
    ($a:ident, |$x:ident| $body:expr) => {{
        // SAFETY: see the top of this section.
        let half = |$x: __m256| unsafe { $body };
        Avx2(half($a.0), half($a.1))
    }};
    ($a:ident, $b:ident, |$x:ident, $y:ident| $body:expr) => {{
        // SAFETY: see the top of this section.
        let half = |$x: __m256, $y: __m256| unsafe { $body };
        (half($a.0, $b.0), half($a.1, $b.1))
    }};
}

impl Real for Avx2 {
    type Mask = Mask2;
    #[inline(always)]
    fn of(value: f64) -> Self {
        Self::splat(value as f32)
    }
    lanewise!(mul_add(self, factor, term), _mm256_fmadd_ps, 0, 1);
    lanewise!(sqrt(self), _mm256_sqrt_ps, 0, 1);
    #[inline(always)]
    fn exp2(self) -> Self {
        let round = Self::splat(12_582_912.0);
        let whole = self + round;
        let p = horner(&EXP2, self - (whole - round));
        let (a, b) = halves!(p, whole, |p, w| {
            let scale = _mm256_slli_epi32::<23>(_mm256_castps_si256(w));
            _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(p), scale))
        });
        Self(a, b)
    }
    #[inline(always)]
    fn log2(self) -> Self {
        let exponent = halves!(self, |x| {
            let bits = _mm256_castps_si256(x);
            let e =
                _mm256_srai_epi32::<23>(_mm256_sub_epi32(bits, _mm256_set1_epi32(SQRT_HALF_BITS)));
            _mm256_cvtepi32_ps(e)
        });
        let (a, b) = halves!(self, exponent, |x, e| {
            let shift = _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(e));
            _mm256_castsi256_ps(_mm256_sub_epi32(_mm256_castps_si256(x), shift))
        });
        let t = Self(a, b) - Self::splat(1.0);
        horner(&LOG2, t).mul_add(t, exponent)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        halves!(self, |x| _mm256_andnot_ps(_mm256_set1_ps(-0.0), x))
    }
    lanewise!(min(self, other), _mm256_min_ps, 0, 1);
    lanewise!(max(self, other), _mm256_max_ps, 0, 1);
    #[inline(always)]
    fn lt(self, other: Self) -> Mask2 {
        let (a, b) = halves!(self, other, |x, y| _mm256_cmp_ps::<_CMP_LT_OQ>(x, y));
        Mask2(a, b)
    }
    #[inline(always)]
    fn le(self, other: Self) -> Mask2 {
        let (a, b) = halves!(self, other, |x, y| _mm256_cmp_ps::<_CMP_LE_OQ>(x, y));
        Mask2(a, b)
    }
    #[inline(always)]
    fn select(mask: Mask2, yes: Self, no: Self) -> Self {
        // SAFETY: see the top of this section.
        unsafe {
            Self(_mm256_blendv_ps(no.0, yes.0, mask.0), _mm256_blendv_ps(no.1, yes.1, mask.1))
        }
    }
}

impl Lanes for Avx2 {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        // SAFETY: see the top of this section.
        unsafe { Self(_mm256_set1_ps(value), _mm256_set1_ps(value)) }
    }
    #[inline(always)]
    fn load(from: &[f32; LANES]) -> Self {
        // SAFETY: see the top of this section; the array holds sixteen floats.
        unsafe { Self(_mm256_loadu_ps(from.as_ptr()), _mm256_loadu_ps(from.as_ptr().add(8))) }
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; LANES]) {
        // SAFETY: see the top of this section; the array holds sixteen floats.
        unsafe {
            _mm256_storeu_ps(to.as_mut_ptr(), self.0);
            _mm256_storeu_ps(to.as_mut_ptr().add(8), self.1);
        }
    }
    #[inline(always)]
    fn store_rounded(self, to: &mut [i32; LANES]) {
        // SAFETY: see the top of this section; the array holds sixteen integers.
        unsafe {
            _mm256_storeu_si256(to.as_mut_ptr().cast(), _mm256_cvtps_epi32(self.0));
            _mm256_storeu_si256(to.as_mut_ptr().add(8).cast(), _mm256_cvtps_epi32(self.1));
        }
    }
    #[inline(always)]
    fn bits(mask: Mask2) -> u16 {
        // SAFETY: see the top of this section.
        unsafe { (_mm256_movemask_ps(mask.0) | (_mm256_movemask_ps(mask.1) << 8)) as u16 }
    }
    #[inline(always)]
    fn from_bits(bits: u16) -> Mask2 {
        // SAFETY: see the top of this section.
        unsafe {
            let lane = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
            let half = |b: u16| {
                let picked = _mm256_and_si256(_mm256_set1_epi32(i32::from(b)), lane);
                _mm256_castsi256_ps(_mm256_cmpeq_epi32(picked, lane))
            };
            Mask2(half(bits & 0xff), half(bits >> 8))
        }
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: see the top of this section.
        unsafe {
            let eight = _mm256_add_ps(self.0, self.1);
            let four = _mm_add_ps(_mm256_castps256_ps128(eight), _mm256_extractf128_ps::<1>(eight));
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps::<1>(two, two)))
        }
    }
    #[inline(always)]
    fn max_lane(self) -> f32 {
        let mut lanes = [0.0; LANES];
        self.store(&mut lanes);
        lanes.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }
    #[inline(always)]
    fn masked(self, mask: Mask2) -> Self {
        // SAFETY: see the top of this section.
        unsafe { Self(_mm256_and_ps(self.0, mask.0), _mm256_and_ps(self.1, mask.1)) }
    }
}
