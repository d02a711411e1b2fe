//! SSIM by rows, the means of its maps blurred along both axes, and its derivatives.

use std::ops::AddAssign;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::math::metric::{Factors, TAPS, factors};
use trisplat_scene::math::real::Real;
use trisplat_scene::parallel;

/// The number type of the loss: f32 for training, f64 for testing the gradient.
pub trait LossNumber:
    Real<Mask = bool> + Default + Send + Sync + PartialOrd + Into<f64> + AddAssign
{
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
        // The last vector begins earlier where it would end beyond the row: those numbers come out
        // the same again.
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
/// Vectors that are summed at once: as many chains of additions as hide their latency, and as fit
/// the registers of AVX2.
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
pub(super) fn blur_column<L: Lanes, R: LossNumber>(
    taps: &[R; TAPS],
    rows: &[R],
    at: usize,
    out: &mut [R],
) {
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
            for value in pixel.iter_mut() {
                *value = *value * w;
            }
        }
    }
}

/// Blurred maps of the forward pass: x, y, x² + y², xy.
pub(super) const MAPS: usize = 4;
/// Blurred maps of the backward pass: ∂S/∂mx, ∂S/∂Gx², ∂S/∂Gxy.
pub(super) const GRADS: usize = 3;

/// Pass 1: x, y, x² + y², xy blurred along x.
pub(super) fn blur_maps<R: LossNumber>(
    taps: &[R; TAPS],
    row: usize,
    x: &[R],
    y: &[R],
    maps: &mut [R],
) {
    parallel::for_each_with(
        maps.chunks_mut(MAPS * row),
        || vec![R::default(); row + 2 * PAD],
        |padded, at, out| {
            let x = &x[at * row..][..row];
            let y = &y[at * row..][..row];
            dispatch(MapsRow { taps, x, y, padded, out });
        },
    );
}

/// One row of pass 1.
struct MapsRow<'a, R> {
    taps: &'a [R; TAPS],
    x: &'a [R],
    y: &'a [R],
    padded: &'a mut [R],
    out: &'a mut [R],
}

impl<R: LossNumber> Work for MapsRow<'_, R> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let row = self.x.len();
        for (map, out) in self.out.chunks_exact_mut(row).enumerate() {
            let inner = &mut self.padded[PAD..PAD + row];
            let pairs = inner.iter_mut().zip(self.x.iter().zip(self.y));
            match map {
                0 => pairs.for_each(|(p, (&a, _))| *p = a),
                1 => pairs.for_each(|(p, (_, &b))| *p = b),
                2 => pairs.for_each(|(p, (&a, &b))| *p = a * a + b * b),
                _ => pairs.for_each(|(p, (&a, &b))| *p = a * b),
            }
            blur_row::<L, R>(self.taps, self.padded, out);
        }
    }
}

/// Pass 2: SSIM per value, its derivatives by the blurred maps, and those blurred along x.
/// Returns the weighted sum of SSIM.
pub(super) fn ssim_rows<R: LossNumber>(
    taps: &[R; TAPS],
    row: usize,
    maps: &[R],
    weight: Option<&[R]>,
    scale: R,
    grads: &mut [R],
) -> f64 {
    let sums = parallel::map_with(
        grads.chunks_mut(GRADS * row),
        || (vec![R::default(); (MAPS + 1) * row], vec![R::default(); GRADS * (row + 2 * PAD)]),
        |(blurred, padded), at, out| {
            let weight = weight.map(|w| &w[at * (row / 3)..][..row / 3]);
            let (blurred, values) = blurred.split_at_mut(MAPS * row);
            dispatch(SsimRow { taps, maps, at, weight, scale, blurred, values, padded, out })
        },
    );
    sums.iter().sum()
}

/// One row of pass 2.
struct SsimRow<'a, R> {
    taps: &'a [R; TAPS],
    maps: &'a [R],
    at: usize,
    weight: Option<&'a [R]>,
    scale: R,
    blurred: &'a mut [R],
    values: &'a mut [R],
    padded: &'a mut [R],
    out: &'a mut [R],
}

impl<R: LossNumber> Work for SsimRow<'_, R> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f64 {
        let row = self.values.len();
        blur_column::<L, R>(self.taps, self.maps, self.at, self.blurred);
        ssim_row(self.blurred, self.scale, self.values, self.padded);
        weight_by(self.values, self.weight);
        for (padded, out) in
            self.padded.chunks_exact_mut(row + 2 * PAD).zip(self.out.chunks_exact_mut(row))
        {
            weight_by(&mut padded[PAD..PAD + row], self.weight);
            blur_row::<L, R>(self.taps, padded, out);
        }
        lane_sum(self.values)
    }
}

/// SSIM of one row, and `scale` times its derivatives in the padded rows.
#[inline(always)]
fn ssim_row<R: LossNumber>(blurred: &[R], scale: R, values: &mut [R], padded: &mut [R]) {
    let row = values.len();
    let map = |m: usize| &blurred[m * row..][..row];
    let mx = map(0);
    let my = map(1);
    let squares = map(2);
    let exy = map(3);
    let (d_mean, rest) = padded.split_at_mut(row + 2 * PAD);
    let (d_square, d_cross) = rest.split_at_mut(row + 2 * PAD);
    let d_mean = &mut d_mean[PAD..][..row];
    let d_square = &mut d_square[PAD..][..row];
    let d_cross = &mut d_cross[PAD..][..row];
    let one = R::of(1.0);
    let two = R::of(2.0);
    for i in 0..row {
        let a = mx[i];
        let b = my[i];
        let variances = squares[i] - a * a - b * b;
        let Factors { luminance, structure, means, variances } = factors(a, b, exy[i], variances);
        let inverse_means = one / means;
        let inverse_variances = one / variances;
        let inverse = inverse_means * inverse_variances;
        let s = luminance * structure * inverse;
        values[i] = s;
        d_mean[i] = scale
            * two
            * (b * (structure - luminance) * inverse + s * a * (inverse_variances - inverse_means));
        d_square[i] = -(scale * s * inverse_variances);
        d_cross[i] = scale * two * luminance * inverse;
    }
}
