//! Arithmetic on interleaved rows, in f32 or f64: Gaussian blurs, weights, sums.

use std::ops::AddAssign;
use trisplat_scene::math::lanes::{LANES, Lanes};
use trisplat_scene::math::real::Real;
use trisplat_scene::math::ssim::TAPS;

/// The number type of the loss: f32 for training, f64 for testing the gradient.
pub trait LossNumber: Real<Mask = bool> + Default + Send + Sync + PartialOrd + Into<f64> + AddAssign {
    /// The weighted sum of rows that start at the same place: `out[i] = Σ tap_k · row_k[i]`.
    fn weighted_sum<L: Lanes>(rows: &[(Self, &[Self])], out: &mut [Self]);
}

impl LossNumber for f32 {
    #[inline(always)]
    fn weighted_sum<L: Lanes>(rows: &[(Self, &[Self])], out: &mut [Self]) {
        let n = out.len();
        if n < LANES {
            return plain_sum(rows, out);
        }
        let whole = n / BLOCK * BLOCK;
        for at in (0..whole).step_by(BLOCK) {
            sum_block::<L, VECTORS>(rows, at, out);
        }
        // The last vector begins earlier where it would end beyond the row: those numbers come out the same again.
        for at in (whole..n).step_by(LANES) {
            sum_block::<L, 1>(rows, at.min(n - LANES), out);
        }
    }
}

impl LossNumber for f64 {
    #[inline(always)]
    fn weighted_sum<L: Lanes>(rows: &[(Self, &[Self])], out: &mut [Self]) {
        plain_sum(rows, out);
    }
}

/// Taps on each side of the middle one.
const REACH: usize = TAPS / 2;
/// Numbers of padding on each side of an interleaved row.
pub(super) const PAD: usize = REACH * 3;
/// Vectors that are summed at once: as many chains of additions as hide their latency, and as fit the
/// registers of AVX2.
const VECTORS: usize = 4;
/// Numbers in them.
const BLOCK: usize = VECTORS * LANES;

/// The weighted sums of the `N` vectors from `at` on.
#[inline(always)]
fn sum_block<L: Lanes, const N: usize>(rows: &[(f32, &[f32])], at: usize, out: &mut [f32]) {
    let mut sums = [L::splat(0.0); N];
    for &(tap, row) in rows {
        let tap = L::splat(tap);
        for (sum, value) in sums.iter_mut().zip(row[at..at + N * LANES].as_chunks().0) {
            *sum = L::load(value).mul_add(tap, *sum);
        }
    }
    for (sum, out) in sums.iter().zip(out[at..at + N * LANES].as_chunks_mut().0) {
        sum.store(out);
    }
}

/// [`LossNumber::weighted_sum`], number by number.
#[inline(always)]
fn plain_sum<R: LossNumber>(rows: &[(R, &[R])], out: &mut [R]) {
    for (i, out) in out.iter_mut().enumerate() {
        *out = R::default();
        for &(tap, row) in rows {
            *out += tap * row[i];
        }
    }
}

/// Blurs a row along x; `padded` has [`PAD`] zeros on both sides of it.
#[inline(always)]
pub(super) fn blur_row<L: Lanes, R: LossNumber>(taps: &[R; TAPS], padded: &[R], out: &mut [R]) {
    let n = out.len();
    let rows: [(R, &[R]); TAPS] = std::array::from_fn(|k| (taps[k], &padded[3 * k..3 * k + n]));
    R::weighted_sum::<L>(&rows, out);
}

/// Blurs along y at row `at`: the sum of `taps` times the rows around it that exist.
#[inline(always)]
pub(super) fn blur_column<L: Lanes, R: LossNumber>(taps: &[R; TAPS], rows: &[R], at: usize, out: &mut [R]) {
    let stride = out.len();
    let height = rows.len() / stride;
    let first = REACH.saturating_sub(at);
    let last = TAPS.min(height + REACH - at);
    let mut near = [(R::default(), &rows[..0]); TAPS];
    for (k, near) in near[first..last].iter_mut().enumerate() {
        let k = first + k;
        *near = (taps[k], &rows[(at + k - REACH) * stride..][..stride]);
    }
    R::weighted_sum::<L>(&near[first..last], out);
}

/// The sum as eight partial sums, which the compiler can keep in one register.
#[inline(always)]
pub(super) fn lane_sum<R: LossNumber>(values: &[R]) -> f64 {
    let mut sums = [0.0; 8];
    for chunk in values.chunks(8) {
        for (sum, &value) in sums.iter_mut().zip(chunk) {
            *sum += value.into();
        }
    }
    sums.iter().sum()
}

/// Multiplies every channel by its pixel's weight.
#[inline(always)]
pub(super) fn weight_by<R: LossNumber>(values: &mut [R], weight: Option<&[R]>) {
    if let Some(weight) = weight {
        for (pixel, &w) in values.chunks_exact_mut(3).zip(weight) {
            pixel.iter_mut().for_each(|v| *v = *v * w);
        }
    }
}
