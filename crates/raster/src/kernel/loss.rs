//! The photometric loss (1 - λ) L1 + λ (1 - SSIM) and its exact gradient (Held et al. 2025, eq. 3;
//! SSIM as [`trisplat_scene::math::metric`] defines it, mean over pixels and channels). A squared
//! error may be added to L1.
//!
//! ```text
//! S = (2 mx my + C1)(2 sxy + C2) / ((mx² + my² + C1)(sxx + syy + C2))
//! mx = G x, my = G y, sxx + syy = G (x² + y²) - mx² - my², sxy = G xy - mx my
//! ∂ΣS/∂x = G(∂S/∂mx) + 2 x G(∂S/∂Gx²) + y G(∂S/∂Gxy)      (G is its own adjoint)
//! ```
//!
//! Rows stay interleaved: a blur along x is the same loop with a stride of three. Three passes,
//! each parallel over rows, each written by one task; sums run over rows in order, so the bits do
//! not depend on the number of threads.

pub use super::ssim::LossNumber;

use super::ssim::{GRADS, MAPS, blur_column, blur_maps, lane_sum, ssim_rows, weight_by};
use trisplat_scene::math::lanes::{Lanes, Work, dispatch};
use trisplat_scene::math::metric::{TAPS, window};
use trisplat_scene::parallel;

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
    /// The loss itself: (1 - λ) L1 + λ (1 - SSIM), with λ = `dssim`.
    pub fn value(&self, dssim: f64) -> f64 {
        (1.0 - dssim) * self.l1 + dssim * (1.0 - self.ssim)
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

/// Returns the means and writes ∂loss/∂rendered. `dssim` is λ, the weight of 1 - SSIM.
///
/// `rendered`, `photo` and `d_rendered` are `[H * W]`, rows from the top; `weight`, when given, is
/// a weight per pixel (a mask), `[H * W]`. The loss is still a mean over all H * W pixels.
pub fn photometric_grad<R: LossNumber>(
    width: usize,
    rendered: &[[R; 3]],
    photo: &[[R; 3]],
    weight: Option<&[R]>,
    dssim: f64,
    scratch: &mut Scratch<R>,
    d_rendered: &mut [[R; 3]],
) -> Photometric {
    if width == 0 || rendered.is_empty() {
        return Photometric { ssim: 1.0, ..Photometric::default() };
    }
    let row = 3 * width;
    let x = rendered.as_flattened();
    let y = photo.as_flattened();
    let count = x.len() as f64;
    let height = x.len() / row;
    scratch.maps.resize(height * MAPS * row, R::default());
    scratch.grads.resize(height * GRADS * row, R::default());
    let taps: [R; TAPS] = window().map(R::of);
    let scale = R::of(-dssim / count);

    blur_maps(&taps, row, x, y, &mut scratch.maps);
    let ssim = ssim_rows(&taps, row, &scratch.maps, weight, scale, &mut scratch.grads);
    let l1_scale = R::of((1.0 - dssim) / count);
    let taps = &taps;
    let grads = &scratch.grads[..];
    // Pass 3: the gradient maps blurred along y, combined with the pictures and the gradient by
    // their difference.
    let sums: Vec<(f64, f64)> = parallel::map_with(
        d_rendered.as_flattened_mut().chunks_mut(row),
        || vec![R::default(); (GRADS + 3) * row],
        |memory, at, out| {
            let x = &x[at * row..][..row];
            let y = &y[at * row..][..row];
            let weight = weight.map(|w| &w[at * width..][..width]);
            let (blurred, parts) = memory.split_at_mut(GRADS * row);
            dispatch(CombineRow { taps, grads, at, x, y, weight, l1_scale, blurred, parts, out })
        },
    );
    let (l1, mse) = sums.iter().fold((0.0, 0.0), |total, s| (total.0 + s.0, total.1 + s.1));
    Photometric { l1: l1 / count, mse: mse / count, ssim: ssim / count }
}

/// One row of pass 3; returns the weighted sums of |x - y| and (x - y)².
struct CombineRow<'a, R> {
    taps: &'a [R; TAPS],
    grads: &'a [R],
    at: usize,
    x: &'a [R],
    y: &'a [R],
    weight: Option<&'a [R]>,
    /// ∂loss/∂x of a pixel that is too bright.
    l1_scale: R,
    blurred: &'a mut [R],
    /// |x - y|, (x - y)² and the gradient by the difference.
    parts: &'a mut [R],
    out: &'a mut [R],
}

impl<R: LossNumber> Work for CombineRow<'_, R> {
    type Output = (f64, f64);

    #[inline(always)]
    fn run<L: Lanes>(self) -> (f64, f64) {
        let x = self.x;
        let y = self.y;
        let zero = R::default();
        let row = x.len();
        blur_column::<L, R>(self.taps, self.grads, self.at, self.blurred);
        let (absolute, rest) = self.parts.split_at_mut(row);
        let (square, by_difference) = rest.split_at_mut(row);
        // Of known length, so that the loops need no check of bounds and become vector code.
        let by_difference = &mut by_difference[..row];
        let out = &mut self.out[..row];
        let y = &y[..row];
        for i in 0..row {
            let difference = x[i] - y[i];
            let above = if difference > zero { self.l1_scale } else { zero };
            by_difference[i] = if difference < zero { -self.l1_scale } else { above };
            absolute[i] = if difference < zero { -difference } else { difference };
            square[i] = difference * difference;
        }
        for values in [&mut *absolute, &mut *square, &mut *by_difference] {
            weight_by(values, self.weight);
        }
        let blur = |m: usize| &self.blurred[m * row..][..row];
        let d_mean = blur(0);
        let d_square = blur(1);
        let d_cross = blur(2);
        for i in 0..row {
            out[i] =
                by_difference[i] + d_mean[i] + R::of(2.0) * x[i] * d_square[i] + y[i] * d_cross[i];
        }
        (lane_sum(absolute), lane_sum(square))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;

    const LAMBDA: f64 = 0.2;

    fn noise(name: &str, n: usize) -> Vec<[f64; 3]> {
        let rng = Rng::new(3, name, 0);
        (0..n).map(|i| std::array::from_fn(|c| rng.uniform_f64((3 * i + c) as u64))).collect()
    }

    fn loss(
        width: usize,
        x: &[[f64; 3]],
        y: &[[f64; 3]],
        w: Option<&[f64]>,
        dssim: f64,
    ) -> (f64, Vec<[f64; 3]>) {
        let mut grad = vec![[0.0; 3]; x.len()];
        let means = photometric_grad(width, x, y, w, dssim, &mut Scratch::default(), &mut grad);
        // With weights the constant 1 of 1 - SSIM is not weighted; it has no gradient.
        (means.value(dssim), grad)
    }

    /// SSIM by its definition, pixel by pixel.
    fn plain_ssim(width: usize, x: &[[f64; 3]], y: &[[f64; 3]]) -> f64 {
        let height = x.len() / width;
        let g: Vec<f64> = (-5..=5).map(|i: i32| (-(f64::from(i * i)) / 4.5).exp()).collect();
        let total: f64 = g.iter().sum();
        let mut sum = 0.0;
        for at in 0..x.len() * 3 {
            let px = (at / 3 % width) as i64;
            let py = (at / 3 / width) as i64;
            let c = at % 3;
            let mut m = [0.0; 5];
            for (j, gy) in g.iter().enumerate() {
                for (i, gx) in g.iter().enumerate() {
                    let u = px + i as i64 - 5;
                    let v = py + j as i64 - 5;
                    if u >= 0 && v >= 0 && u < width as i64 && v < height as i64 {
                        let a = x[v as usize * width + u as usize][c];
                        let b = y[v as usize * width + u as usize][c];
                        let w = gx * gy / (total * total);
                        for (m, value) in m.iter_mut().zip([a, b, a * a, b * b, a * b]) {
                            *m += w * value;
                        }
                    }
                }
            }
            let sxx = m[2] - m[0] * m[0];
            let syy = m[3] - m[1] * m[1];
            let sxy = m[4] - m[0] * m[1];
            sum += (2.0 * m[0] * m[1] + 1e-4) * (2.0 * sxy + 9e-4)
                / ((m[0] * m[0] + m[1] * m[1] + 1e-4) * (sxx + syy + 9e-4));
        }
        sum / (x.len() * 3) as f64
    }

    #[test]
    fn ssim_is_the_definition() {
        let x = noise("x", 17 * 9);
        let y = noise("y", 17 * 9);
        let mut grad = vec![[0.0; 3]; x.len()];
        let means = photometric_grad(17, &x, &y, None, LAMBDA, &mut Scratch::default(), &mut grad);
        assert!((means.ssim - plain_ssim(17, &x, &y)).abs() < 2e-7, "{}", means.ssim);
    }

    #[test]
    fn gradient_is_the_derivative() {
        let width = 14;
        let x = noise("x", width * 12);
        let y = noise("y", width * 12);
        let w: Vec<f64> = noise("w", width * 12).iter().map(|v| v[0]).collect();
        for (dssim, weight) in [(0.2, None), (1.0, None), (0.0, None), (0.4, Some(&w[..]))] {
            let (_, grad) = loss(width, &x, &y, weight, dssim);
            for at in (0..x.len() * 3).step_by(7) {
                let p = at / 3;
                let c = at % 3;
                let h = 1e-5;
                let mut moved = x.clone();
                moved[p][c] = x[p][c] + h;
                let up = loss(width, &moved, &y, weight, dssim).0;
                moved[p][c] = x[p][c] - h;
                let down = loss(width, &moved, &y, weight, dssim).0;
                let difference = (up - down) / (2.0 * h);
                // λ passes through f32 once (scale): 6e-8 relative; the rest is the difference
                // quotient's own.
                assert!(
                    (difference - grad[p][c]).abs() < 1e-9,
                    "{at}: {difference} vs {}",
                    grad[p][c]
                );
            }
        }
    }

    fn narrow(v: &[[f64; 3]]) -> Vec<[f32; 3]> {
        v.iter().map(|p| p.map(|c| c as f32)).collect()
    }

    #[test]
    fn f32_is_f64_and_equal_pictures_have_no_gradient() {
        let x = noise("x", 33 * 21);
        let y = noise("y", 33 * 21);
        let x32 = narrow(&x);
        let y32 = narrow(&y);
        let mut grad = vec![[0.0f32; 3]; x.len()];
        let small =
            photometric_grad(33, &x32, &y32, None, LAMBDA, &mut Scratch::default(), &mut grad);
        let (large, exact) = loss(33, &x, &y, None, LAMBDA);
        assert!((small.value(LAMBDA) - large).abs() < 1e-6);
        for (g, e) in grad.as_flattened().iter().zip(exact.as_flattened()) {
            assert!((f64::from(*g) - e).abs() < 1e-8, "{g} {e}");
        }
        let same =
            photometric_grad(33, &x32, &x32, None, LAMBDA, &mut Scratch::default(), &mut grad);
        assert_eq!(same.l1, 0.0);
        assert!((same.ssim - 1.0).abs() < 1e-6);
        assert!(grad.as_flattened().iter().all(|g| g.abs() < 1e-8));
    }

    #[test]
    fn pale_pictures_of_little_contrast_keep_four_digits() {
        let pale = |name: &str| {
            noise(name, 33 * 21)
                .iter()
                .map(|p| p.map(|c| 0.9 + 0.02 * (c - 0.5)))
                .collect::<Vec<_>>()
        };
        let x32 = narrow(&pale("x"));
        let y32 = narrow(&pale("y"));
        let wide = |v: &[[f32; 3]]| v.iter().map(|p| p.map(f64::from)).collect::<Vec<_>>();
        let mut grad = vec![[0.0f32; 3]; x32.len()];
        let small =
            photometric_grad(33, &x32, &y32, None, LAMBDA, &mut Scratch::default(), &mut grad);
        let (large, exact) = loss(33, &wide(&x32), &wide(&y32), None, LAMBDA);
        let error = (small.value(LAMBDA) - large).abs() / large;
        let mut difference = 0.0;
        let mut all = 0.0;
        for (g, e) in grad.as_flattened().iter().zip(exact.as_flattened()) {
            difference += (f64::from(*g) - e).powi(2);
            all += e.powi(2);
        }
        let slope = (difference / all).sqrt();
        // Variances are differences of numbers near 2, beside 0.0009: 5.7e-5 and 4.4e-5 measured.
        assert!(error < 1e-4 && slope < 1e-4, "figure {error:.1e}, gradient {slope:.1e}");
    }

    #[test]
    fn one_pixel_and_no_pixel() {
        let mut grad = vec![[0.0f32; 3]; 1];
        let means = photometric_grad(
            1,
            &[[0.0; 3]],
            &[[0.0; 3]],
            None,
            LAMBDA,
            &mut Scratch::default(),
            &mut grad,
        );
        assert!(means.ssim.is_finite() && grad[0].iter().all(|g| g.is_finite()));
        let none =
            photometric_grad::<f32>(0, &[], &[], None, LAMBDA, &mut Scratch::default(), &mut []);
        assert_eq!(none.value(LAMBDA), 0.0);
    }
}
