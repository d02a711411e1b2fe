//! The photometric loss (1 - λ) L1 + λ (1 - SSIM) and its exact gradient (Held et al. 2025, eq. 3; SSIM as
//! in 3DGS: 11-tap gaussian of deviation 1.5, zeros outside the picture, mean over pixels and channels).
//!
//! ```text
//! S = (2 mx my + C1)(2 sxy + C2) / ((mx² + my² + C1)(sxx + syy + C2))
//! mx = G x, my = G y, sxx = G x² - mx², syy = G y² - my², sxy = G xy - mx my
//! ∂ΣS/∂x = G(∂S/∂mx) + 2 x G(∂S/∂Gx²) + y G(∂S/∂Gxy)      (G is its own adjoint)
//! ```
//!
//! Rows stay interleaved: a blur along x is the same loop with a stride of three. Three passes, each
//! parallel over rows that no other job writes; sums run over rows in order, so the bits do not depend on
//! the number of threads.

use crate::math::lanes::{Lanes, Work, dispatch};
use rayon::prelude::*;
use std::ops::{Add, AddAssign, Div, Mul, Neg, Sub};

/// What the loss needs of a number; f32 trains, f64 proves the gradient.
pub trait Number:
    Copy
    + Default
    + Send
    + Sync
    + PartialOrd
    + From<f32>
    + Into<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
{
}
impl Number for f32 {}
impl Number for f64 {}

/// Taps of the SSIM window.
const TAPS: usize = 11;
/// Taps on each side of the middle one.
const REACH: usize = TAPS / 2;
/// Floats of padding on each side of an interleaved row.
const PAD: usize = REACH * 3;
/// Blurred maps of the forward pass: x, y, x², y², xy.
const MAPS: usize = 5;
/// Blurred maps of the backward pass: ∂S/∂mx, ∂S/∂Gx², ∂S/∂Gxy.
const GRADS: usize = 3;
/// (0.01)², SSIM's luminance constant for values in [0, 1].
const C1: f32 = 0.0001;
/// (0.03)², SSIM's contrast constant for values in [0, 1].
const C2: f32 = 0.0009;

/// Means over pixels and channels.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Photometric {
    /// Mean |x - y|.
    pub l1: f64,
    /// Mean SSIM.
    pub ssim: f64,
    /// Mean (x - y)²: PSNR = -10 log10 of it.
    pub mse: f64,
}

impl Photometric {
    /// The loss itself: (1 - λ) L1 + λ (1 - SSIM).
    pub fn value(&self, lambda_dssim: f64) -> f64 {
        (1.0 - lambda_dssim) * self.l1 + lambda_dssim * (1.0 - self.ssim)
    }

    /// Peak signal to noise ratio, dB, for values in [0, 1].
    pub fn psnr(&self) -> f64 {
        -10.0 * self.mse.max(1e-12).log10()
    }
}

/// Working memory of [`photometric_grad`], kept between steps.
#[derive(Debug, Default)]
pub struct Scratch<R> {
    /// Blurred along x: [H, MAPS, 3 W].
    maps: Vec<R>,
    /// Gradient maps blurred along x: [H, GRADS, 3 W].
    grads: Vec<R>,
}

/// Returns the means and writes ∂loss/∂rendered.
///
/// `rendered`, `photo` and `d_rendered` are `[H * W]`, rows from the top; `weight`, when given, scales what
/// each pixel counts (a mask), `[H * W]`. The loss is a mean over all H * W pixels whatever the weights.
pub fn photometric_grad<R: Number>(
    width: usize,
    rendered: &[[R; 3]],
    photo: &[[R; 3]],
    weight: Option<&[R]>,
    lambda_dssim: f64,
    scratch: &mut Scratch<R>,
    d_rendered: &mut [[R; 3]],
) -> Photometric {
    if width == 0 || rendered.is_empty() {
        return Photometric { ssim: 1.0, ..Photometric::default() };
    }
    let row = 3 * width;
    let (x, y) = (rendered.as_flattened(), photo.as_flattened());
    let count = x.len() as f64;
    let height = x.len() / row;
    scratch.maps.resize(height * MAPS * row, R::default());
    scratch.grads.resize(height * GRADS * row, R::default());
    let taps = window::<R>();
    let scale = R::from((-lambda_dssim / count) as f32);

    blur_maps(&taps, row, x, y, &mut scratch.maps);
    let ssim = ssim_rows(&taps, row, &scratch.maps, weight, scale, &mut scratch.grads);
    let l1_scale = R::from(((1.0 - lambda_dssim) / count) as f32);
    let sums =
        combine_rows(&taps, row, x, y, weight, l1_scale, &scratch.grads, d_rendered.as_flattened_mut());
    Photometric { l1: sums.0 / count, mse: sums.1 / count, ssim: ssim / count }
}

/// The normalised gaussian window.
fn window<R: Number>() -> [R; TAPS] {
    let raw: [f64; TAPS] = std::array::from_fn(|i| (-(i as f64 - REACH as f64).powi(2) / 4.5).exp());
    let sum: f64 = raw.iter().sum();
    raw.map(|t| R::from((t / sum) as f32))
}

/// Values worked on at a time: what fits the registers of any CPU.
const BLOCK: usize = 32;

/// The weighted sum of rows that start at the same place: `out[i] = Σ tap_k · row_k[i]`.
#[inline(always)]
fn weigh<R: Number>(rows: &[(R, &[R])], out: &mut [R]) {
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
fn blur_row<R: Number>(taps: &[R; TAPS], padded: &[R], out: &mut [R]) {
    let n = out.len();
    let rows: [(R, &[R]); TAPS] = std::array::from_fn(|k| (taps[k], &padded[3 * k..3 * k + n]));
    weigh(&rows, out);
}

/// Blurs along y at row `at`: the sum of `taps` times the rows around it that exist.
#[inline(always)]
fn blur_column<R: Number>(taps: &[R; TAPS], rows: &[R], at: usize, out: &mut [R]) {
    let stride = out.len();
    let height = rows.len() / stride;
    let first = REACH.saturating_sub(at);
    let last = TAPS.min(height + REACH - at);
    let mut near = [(R::default(), &rows[..0]); TAPS];
    for (k, near) in near[first..last].iter_mut().enumerate() {
        let k = first + k;
        *near = (taps[k], &rows[(at + k - REACH) * stride..][..stride]);
    }
    weigh(&near[first..last], out);
}

/// The sum in eight strands, which the compiler can keep side by side.
#[inline(always)]
fn strand_sum<R: Number>(values: &[R]) -> f64 {
    let mut strands = [0.0; 8];
    for chunk in values.chunks(8) {
        for (strand, &value) in strands.iter_mut().zip(chunk) {
            *strand += value.into();
        }
    }
    strands.iter().sum()
}

/// Multiplies every channel by its pixel's weight.
#[inline(always)]
fn weight_by<R: Number>(values: &mut [R], weight: Option<&[R]>) {
    if let Some(weight) = weight {
        for (pixel, &w) in values.chunks_exact_mut(3).zip(weight) {
            pixel.iter_mut().for_each(|v| *v = *v * w);
        }
    }
}

/// Pass 1: x, y, x², y², xy blurred along x.
fn blur_maps<R: Number>(taps: &[R; TAPS], row: usize, x: &[R], y: &[R], maps: &mut [R]) {
    maps.par_chunks_mut(MAPS * row).enumerate().for_each_init(
        || vec![R::default(); row + 2 * PAD],
        |padded, (at, out)| {
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

impl<R: Number> Work for MapsRow<'_, R> {
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
                2 => pairs.for_each(|(p, (&a, _))| *p = a * a),
                3 => pairs.for_each(|(p, (_, &b))| *p = b * b),
                _ => pairs.for_each(|(p, (&a, &b))| *p = a * b),
            }
            blur_row(self.taps, self.padded, out);
        }
    }
}

/// Pass 2: SSIM per value, its derivatives by the blurred maps, and those blurred along x.
/// Returns the weighted sum of SSIM.
fn ssim_rows<R: Number>(
    taps: &[R; TAPS],
    row: usize,
    maps: &[R],
    weight: Option<&[R]>,
    scale: R,
    grads: &mut [R],
) -> f64 {
    let sums: Vec<f64> = grads
        .par_chunks_mut(GRADS * row)
        .enumerate()
        .map_init(
            || (vec![R::default(); (MAPS + 1) * row], vec![R::default(); GRADS * (row + 2 * PAD)]),
            |(blurred, padded), (at, out)| {
                let weight = weight.map(|w| &w[at * (row / 3)..][..row / 3]);
                let (blurred, values) = blurred.split_at_mut(MAPS * row);
                dispatch(SsimRow { taps, maps, at, weight, scale, blurred, values, padded, out })
            },
        )
        .collect();
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

impl<R: Number> Work for SsimRow<'_, R> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes>(self) -> f64 {
        let row = self.values.len();
        blur_column(self.taps, self.maps, self.at, self.blurred);
        ssim_row(self.blurred, self.scale, self.values, self.padded);
        weight_by(self.values, self.weight);
        for (padded, out) in self.padded.chunks_exact_mut(row + 2 * PAD).zip(self.out.chunks_exact_mut(row)) {
            weight_by(&mut padded[PAD..PAD + row], self.weight);
            blur_row(self.taps, padded, out);
        }
        strand_sum(self.values)
    }
}

/// SSIM of one row, and `scale` times its derivatives in the padded rows.
#[inline(always)]
fn ssim_row<R: Number>(blurred: &[R], scale: R, values: &mut [R], padded: &mut [R]) {
    let row = values.len();
    let map = |m: usize| &blurred[m * row..][..row];
    let (mx, my, exx, eyy, exy) = (map(0), map(1), map(2), map(3), map(4));
    let (d_mean, rest) = padded.split_at_mut(row + 2 * PAD);
    let (d_square, d_cross) = rest.split_at_mut(row + 2 * PAD);
    let (d_mean, d_square, d_cross) =
        (&mut d_mean[PAD..][..row], &mut d_square[PAD..][..row], &mut d_cross[PAD..][..row]);
    let (c1, c2, one, two) = (R::from(C1), R::from(C2), R::from(1.0), R::from(2.0));
    for i in 0..row {
        let (a, b) = (mx[i], my[i]);
        let luminance = two * a * b + c1;
        let structure = two * (exy[i] - a * b) + c2;
        let inverse_means = one / (a * a + b * b + c1);
        let inverse_variances = one / (exx[i] - a * a + eyy[i] - b * b + c2);
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

/// Pass 3: the gradient maps blurred along y, put together with the pictures and the L1 sign.
/// Returns the weighted sums of |x - y| and (x - y)².
#[allow(clippy::too_many_arguments)]
fn combine_rows<R: Number>(
    taps: &[R; TAPS],
    row: usize,
    x: &[R],
    y: &[R],
    weight: Option<&[R]>,
    l1_scale: R,
    grads: &[R],
    d_x: &mut [R],
) -> (f64, f64) {
    let sums: Vec<(f64, f64)> = d_x
        .par_chunks_mut(row)
        .enumerate()
        .map_init(
            || vec![R::default(); (GRADS + 3) * row],
            |memory, (at, out)| {
                let (x, y) = (&x[at * row..][..row], &y[at * row..][..row]);
                let weight = weight.map(|w| &w[at * (row / 3)..][..row / 3]);
                let (blurred, parts) = memory.split_at_mut(GRADS * row);
                dispatch(CombineRow { taps, grads, at, x, y, weight, l1_scale, blurred, parts, out })
            },
        )
        .collect();
    sums.iter().fold((0.0, 0.0), |total, s| (total.0 + s.0, total.1 + s.1))
}

/// One row of pass 3.
struct CombineRow<'a, R> {
    taps: &'a [R; TAPS],
    grads: &'a [R],
    at: usize,
    x: &'a [R],
    y: &'a [R],
    weight: Option<&'a [R]>,
    l1_scale: R,
    blurred: &'a mut [R],
    /// |x - y|, (x - y)² and the L1 gradient.
    parts: &'a mut [R],
    out: &'a mut [R],
}

impl<R: Number> Work for CombineRow<'_, R> {
    type Output = (f64, f64);

    #[inline(always)]
    fn run<L: Lanes>(self) -> (f64, f64) {
        let (x, y, zero) = (self.x, self.y, R::default());
        let row = x.len();
        blur_column(self.taps, self.grads, self.at, self.blurred);
        let (absolute, rest) = self.parts.split_at_mut(row);
        let (square, d_absolute) = rest.split_at_mut(row);
        for i in 0..row {
            let difference = x[i] - y[i];
            let above = if difference > zero { self.l1_scale } else { zero };
            d_absolute[i] = if difference < zero { -self.l1_scale } else { above };
            absolute[i] = if difference < zero { -difference } else { difference };
            square[i] = difference * difference;
        }
        for values in [&mut *absolute, &mut *square, &mut *d_absolute] {
            weight_by(values, self.weight);
        }
        let blur = |m: usize| &self.blurred[m * row..][..row];
        let (d_mean, d_square, d_cross) = (blur(0), blur(1), blur(2));
        for i in 0..row {
            self.out[i] = d_absolute[i] + d_mean[i] + R::from(2.0) * x[i] * d_square[i] + y[i] * d_cross[i];
        }
        (strand_sum(absolute), strand_sum(square))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    fn noise(name: &str, n: usize) -> Vec<[f64; 3]> {
        let rng = Rng::new(3, name, 0);
        (0..n).map(|i| std::array::from_fn(|c| rng.uniform_f64((3 * i + c) as u64))).collect()
    }

    fn loss(
        width: usize,
        x: &[[f64; 3]],
        y: &[[f64; 3]],
        w: Option<&[f64]>,
        lambda: f64,
    ) -> (f64, Vec<[f64; 3]>) {
        let mut grad = vec![[0.0; 3]; x.len()];
        let means = photometric_grad(width, x, y, w, lambda, &mut Scratch::default(), &mut grad);
        // With weights the constant 1 of 1 - SSIM is not weighted; it has no gradient.
        (means.value(lambda), grad)
    }

    /// SSIM written down straight from its definition, pixel by pixel.
    fn plain_ssim(width: usize, x: &[[f64; 3]], y: &[[f64; 3]]) -> f64 {
        let height = x.len() / width;
        let g: Vec<f64> = (-5..=5).map(|i: i32| (-(f64::from(i * i)) / 4.5).exp()).collect();
        let total: f64 = g.iter().sum();
        let mut sum = 0.0;
        for at in 0..x.len() * 3 {
            let (px, py, c) = ((at / 3 % width) as i64, (at / 3 / width) as i64, at % 3);
            let mut m = [0.0; 5];
            for (j, gy) in g.iter().enumerate() {
                for (i, gx) in g.iter().enumerate() {
                    let (u, v) = (px + i as i64 - 5, py + j as i64 - 5);
                    if u >= 0 && v >= 0 && u < width as i64 && v < height as i64 {
                        let (a, b) =
                            (x[v as usize * width + u as usize][c], y[v as usize * width + u as usize][c]);
                        let w = gx * gy / (total * total);
                        for (m, value) in m.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                            *m += w * value;
                        }
                    }
                }
            }
            let (sxx, syy, sxy) = (m[2] - m[0] * m[0], m[3] - m[1] * m[1], m[4] - m[0] * m[1]);
            sum += (2.0 * m[0] * m[1] + 1e-4) * (2.0 * sxy + 9e-4)
                / ((m[0] * m[0] + m[1] * m[1] + 1e-4) * (sxx + syy + 9e-4));
        }
        sum / (x.len() * 3) as f64
    }

    #[test]
    fn ssim_is_the_definition() {
        let (x, y) = (noise("x", 17 * 9), noise("y", 17 * 9));
        let mut grad = vec![[0.0; 3]; x.len()];
        let means = photometric_grad(17, &x, &y, None, 0.2, &mut Scratch::default(), &mut grad);
        assert!((means.ssim - plain_ssim(17, &x, &y)).abs() < 2e-7, "{}", means.ssim);
    }

    #[test]
    fn gradient_is_the_derivative() {
        let width = 14;
        let (x, y) = (noise("x", width * 12), noise("y", width * 12));
        let w: Vec<f64> = noise("w", width * 12).iter().map(|v| v[0]).collect();
        for (lambda, weight) in [(0.2, None), (1.0, None), (0.0, None), (0.4, Some(&w[..]))] {
            let (_, grad) = loss(width, &x, &y, weight, lambda);
            for at in (0..x.len() * 3).step_by(7) {
                let (p, c, h) = (at / 3, at % 3, 1e-5);
                let mut moved = x.clone();
                moved[p][c] = x[p][c] + h;
                let up = loss(width, &moved, &y, weight, lambda).0;
                moved[p][c] = x[p][c] - h;
                let down = loss(width, &moved, &y, weight, lambda).0;
                let difference = (up - down) / (2.0 * h);
                // λ passes through f32 once (scale): 6e-8 relative; the rest is the difference quotient's own.
                assert!((difference - grad[p][c]).abs() < 1e-9, "{at}: {difference} vs {}", grad[p][c]);
            }
        }
    }

    #[test]
    fn f32_is_f64_and_equal_pictures_have_no_gradient() {
        let (x, y) = (noise("x", 33 * 21), noise("y", 33 * 21));
        let narrow = |v: &[[f64; 3]]| v.iter().map(|p| p.map(|c| c as f32)).collect::<Vec<_>>();
        let (x32, y32) = (narrow(&x), narrow(&y));
        let mut grad = vec![[0.0f32; 3]; x.len()];
        let small = photometric_grad(33, &x32, &y32, None, 0.2, &mut Scratch::default(), &mut grad);
        let (large, exact) = loss(33, &x, &y, None, 0.2);
        assert!((small.value(0.2) - large).abs() < 1e-6);
        for (g, e) in grad.as_flattened().iter().zip(exact.as_flattened()) {
            assert!((f64::from(*g) - e).abs() < 1e-8, "{g} {e}");
        }
        let same = photometric_grad(33, &x32, &x32, None, 0.2, &mut Scratch::default(), &mut grad);
        assert_eq!(same.l1, 0.0);
        assert!((same.ssim - 1.0).abs() < 1e-6);
        assert!(grad.as_flattened().iter().all(|g| g.abs() < 1e-8));
    }

    #[test]
    fn one_pixel_and_no_pixel() {
        let mut grad = vec![[0.0f32; 3]; 1];
        let means =
            photometric_grad(1, &[[0.0; 3]], &[[0.0; 3]], None, 0.2, &mut Scratch::default(), &mut grad);
        assert!(means.ssim.is_finite() && grad[0].iter().all(|g| g.is_finite()));
        let none = photometric_grad::<f32>(0, &[], &[], None, 0.2, &mut Scratch::default(), &mut []);
        assert_eq!(none.value(0.2), 0.0);
    }
}
