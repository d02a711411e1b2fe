//! The structural part of the loss: blurred moments, SSIM and its derivatives.

use super::rows::{LossNumber, PAD, blur_column, blur_row, lane_sum, weight_by};
use trisplat_scene::math::lanes::{Lanes, Work, dispatch};
use trisplat_scene::math::ssim::{Factors, TAPS, factors};
use trisplat_scene::parallel;

/// Blurred maps of the forward pass: x, y, x² + y², xy.
pub(super) const MAPS: usize = 4;
/// Blurred maps of the backward pass: ∂S/∂mx, ∂S/∂Gx², ∂S/∂Gxy.
pub(super) const GRADS: usize = 3;

/// Pass 1: x, y, x² + y², xy blurred along x.
pub(super) fn blur_maps<R: LossNumber>(taps: &[R; TAPS], row: usize, x: &[R], y: &[R], maps: &mut [R]) {
    parallel::for_each_with(
        maps.chunks_mut(MAPS * row),
        || vec![R::default(); row + 2 * PAD],
        |padded, at, out| {
            let (x, y) = (&x[at * row..][..row], &y[at * row..][..row]);
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
        for (padded, out) in self.padded.chunks_exact_mut(row + 2 * PAD).zip(self.out.chunks_exact_mut(row)) {
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
    let (mx, my, squares, exy) = (map(0), map(1), map(2), map(3));
    let (d_mean, rest) = padded.split_at_mut(row + 2 * PAD);
    let (d_square, d_cross) = rest.split_at_mut(row + 2 * PAD);
    let (d_mean, d_square, d_cross) =
        (&mut d_mean[PAD..][..row], &mut d_square[PAD..][..row], &mut d_cross[PAD..][..row]);
    let (one, two) = (R::of(1.0), R::of(2.0));
    for i in 0..row {
        let (a, b) = (mx[i], my[i]);
        let variances = squares[i] - a * a - b * b;
        let Factors { luminance, structure, means, variances } = factors(a, b, exy[i], variances);
        let (inverse_means, inverse_variances) = (one / means, one / variances);
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
