//! Arithmetic on interleaved rows, in f32 or f64: Gaussian blurs, weights, sums.

use std::ops::AddAssign;
use trisplat_scene::math::real::Real;
use trisplat_scene::math::ssim::TAPS;

/// The number type of the loss: f32 for training, f64 for testing the gradient.
pub trait LossNumber: Real<Mask = bool> + Default + Send + Sync + PartialOrd + Into<f64> + AddAssign {}
impl LossNumber for f32 {}
impl LossNumber for f64 {}

/// Taps on each side of the middle one.
const REACH: usize = TAPS / 2;
/// Numbers of padding on each side of an interleaved row.
pub(super) const PAD: usize = REACH * 3;
/// Values per step; they fit the registers of any CPU.
const BLOCK: usize = 32;

/// The weighted sum of rows that start at the same place: `out[i] = Σ tap_k · row_k[i]`.
#[inline(always)]
fn weighted_sum<R: LossNumber>(rows: &[(R, &[R])], out: &mut [R]) {
    let whole = out.len() / BLOCK * BLOCK;
    let (blocks, rest) = out.split_at_mut(whole);
    for (b, out) in blocks.chunks_exact_mut(BLOCK).enumerate() {
        let mut sums = [R::default(); BLOCK];
        for &(tap, row) in rows {
            for (sum, &value) in sums.iter_mut().zip(&row[b * BLOCK..][..BLOCK]) {
                *sum += tap * value;
            }
        }
        out.copy_from_slice(&sums);
    }
    for (i, out) in rest.iter_mut().enumerate() {
        *out = R::default();
        for &(tap, row) in rows {
            *out += tap * row[whole + i];
        }
    }
}

/// Blurs a row along x; `padded` has [`PAD`] zeros on both sides of it.
#[inline(always)]
pub(super) fn blur_row<R: LossNumber>(taps: &[R; TAPS], padded: &[R], out: &mut [R]) {
    let n = out.len();
    let rows: [(R, &[R]); TAPS] = std::array::from_fn(|k| (taps[k], &padded[3 * k..3 * k + n]));
    weighted_sum(&rows, out);
}

/// Blurs along y at row `at`: the sum of `taps` times the rows around it that exist.
#[inline(always)]
pub(super) fn blur_column<R: LossNumber>(taps: &[R; TAPS], rows: &[R], at: usize, out: &mut [R]) {
    let stride = out.len();
    let height = rows.len() / stride;
    let first = REACH.saturating_sub(at);
    let last = TAPS.min(height + REACH - at);
    let mut near = [(R::default(), &rows[..0]); TAPS];
    for (k, near) in near[first..last].iter_mut().enumerate() {
        let k = first + k;
        *near = (taps[k], &rows[(at + k - REACH) * stride..][..stride]);
    }
    weighted_sum(&near[first..last], out);
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
