//! Image metrics between a picture and a photo: PSNR, SSIM and FLIP on 8-bit sRGB pixels.
//!
//! Conventions of 3DGS and everything measured against it: PSNR over all channels of one image,
//! SSIM of Wang et al. 2004 with an 11x11 Gaussian, σ 1.5, zero padding, mean over channels. A
//! weight per pixel, 0 to 255, excludes masked pixels; `None` weights all equally.

use super::real::Real;
use crate::parallel;
use glam::UVec2;

/// Minimum mean squared error, 120 dB: below it two pictures count as equal.
const MIN_SQUARED_ERROR: f64 = 1e-12;

/// Peak signal-to-noise ratio in dB: -10 log10 of the mean squared error, 120 for equal pictures.
/// The pictures must have the same number of pixels.
pub fn psnr(a: &[[u8; 3]], b: &[[u8; 3]], weights: Option<&[u8]>) -> f64 {
    assert_eq!(a.len(), b.len(), "pictures of different sizes");
    let squared = |i: usize| -> f64 {
        (0..3).map(|c| f64::from(i32::from(a[i][c]) - i32::from(b[i][c])).powi(2)).sum::<f64>()
            / 3.0
    };
    let mean = weighted_mean((0..a.len()).map(squared), weights);
    -10.0 * (mean / (255.0 * 255.0)).max(MIN_SQUARED_ERROR).log10()
}

/// Structural similarity in [-1, 1], 1 for equal pictures. The mean over pixels and channels of
/// Wang et al. 2004, with a Gaussian window as 3DGS has it.
pub fn ssim(size: UVec2, a: &[[u8; 3]], b: &[[u8; 3]], weights: Option<&[u8]>) -> f64 {
    let width = size.x as usize;
    assert_eq!(a.len(), width * size.y as usize, "the size is not the picture's");
    assert_eq!(a.len(), b.len(), "pictures of different sizes");
    let window = window();
    let rows: Vec<Vec<f64>> =
        parallel::map(0..size.y as usize, |_, y| ssim_row(width, a, b, y, &window));
    weighted_mean(rows.into_iter().flatten(), weights)
}

/// Mean FLIP error in [0, 1], 0 for equal pictures (Andersson et al. 2020, LDR, 67 pixels per
/// degree). Not symmetric: the photo is the reference. NaN when the size does not match the
/// pictures.
pub fn flip(size: UVec2, reference: &[[u8; 3]], test: &[[u8; 3]], weights: Option<&[u8]>) -> f64 {
    let picture = |rgb: &[[u8; 3]]| {
        flip_rs::RgbImage::new(size.x as usize, size.y as usize, rgb.as_flattened().to_vec())
    };
    let Ok(reference) = picture(reference) else { return f64::NAN };
    let Ok(test) = picture(test) else { return f64::NAN };
    let map = flip_rs::ldr_flip(&reference, &test, flip_rs::DEFAULT_PPD);
    map.map_or(f64::NAN, |map| weighted_mean(map.into_pixels().into_iter().map(f64::from), weights))
}

/// The SSIM of every pixel of row `y`, mean over channels. `[W]`
fn ssim_row(
    width: usize,
    a: &[[u8; 3]],
    b: &[[u8; 3]],
    y: usize,
    window: &[f64; TAPS],
) -> Vec<f64> {
    let half = TAPS / 2;
    let height = a.len() / width;
    // Per channel: a, b, a², b², ab, filtered down the column. `[W][3][5]`
    let mut columns = vec![[[0.0f64; 5]; 3]; width];
    for (tap, weight) in window.iter().enumerate() {
        let Some(row) = (y + tap).checked_sub(half).filter(|&row| row < height) else { continue };
        let ra = &a[row * width..(row + 1) * width];
        let rb = &b[row * width..(row + 1) * width];
        for ((sums, pa), pb) in columns.iter_mut().zip(ra).zip(rb) {
            for c in 0..3 {
                let va = f64::from(pa[c]) / 255.0;
                let vb = f64::from(pb[c]) / 255.0;
                let products = [va, vb, va * va, vb * vb, va * vb];
                for (sum, product) in sums[c].iter_mut().zip(products) {
                    *sum += weight * product;
                }
            }
        }
    }
    let pixel = |x: usize| {
        let mut sums = [[0.0f64; 5]; 3];
        for (tap, weight) in window.iter().enumerate() {
            let Some(column) = (x + tap).checked_sub(half).and_then(|at| columns.get(at)) else {
                continue;
            };
            for c in 0..3 {
                for (sum, value) in sums[c].iter_mut().zip(column[c]) {
                    *sum += weight * value;
                }
            }
        }
        sums.iter().map(ssim_of_moments).sum::<f64>() / 3.0
    };
    (0..width).map(pixel).collect()
}

/// SSIM from the filtered a, b, a², b², ab.
fn ssim_of_moments(&[ma, mb, aa, bb, ab]: &[f64; 5]) -> f64 {
    let Factors { luminance, structure, means, variances } =
        factors(ma, mb, ab, (aa - ma * ma) + (bb - mb * mb));
    (luminance * structure) / (means * variances)
}

/// Weighted mean of `values`; 0 when all weights are 0.
fn weighted_mean(values: impl Iterator<Item = f64>, weights: Option<&[u8]>) -> f64 {
    let mut sum = 0.0;
    let mut total = 0.0;
    for (i, value) in values.enumerate() {
        let weight = weights.map_or(1.0, |w| f64::from(w[i]) / 255.0);
        // Skipped instead of multiplied by zero, because a masked pixel may have any value.
        if weight > 0.0 {
            sum += weight * value;
            total += weight;
        }
    }
    if total > 0.0 { sum / total } else { 0.0 }
}

// ---- SSIM (Wang et al. 2004) with the conventions of 3DGS, shared by the loss and the metric ----
//
// ssim = (2 μa μb + C1) (2 σab + C2) / ((μa² + μb² + C1) (σa² + σb² + C2))
//
// Moments are taken under an 11x11 Gaussian window of deviation 1.5 px, zeros outside the picture;
// values are in [0, 1].

/// Taps of the window along each axis.
pub const TAPS: usize = 11;
/// Standard deviation of the window, px.
const SIGMA_PX: f64 = 1.5;
/// (0.01)², the luminance constant.
pub(super) const C1: f64 = 1e-4;
/// (0.03)², the contrast constant.
pub(super) const C2: f64 = 9e-4;

/// The taps of the window along one axis, summing to 1.
pub fn window() -> [f64; TAPS] {
    let middle = (TAPS / 2) as f64;
    let taps: [f64; TAPS] =
        std::array::from_fn(|i| (-(i as f64 - middle).powi(2) / (2.0 * SIGMA_PX * SIGMA_PX)).exp());
    let sum: f64 = taps.iter().sum();
    taps.map(|tap| tap / sum)
}

/// The factors of SSIM: luminance · structure / (means · variances).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Factors<R> {
    /// 2 μa μb + C1.
    pub luminance: R,
    /// 2 σab + C2.
    pub structure: R,
    /// μa² + μb² + C1.
    pub means: R,
    /// σa² + σb² + C2.
    pub variances: R,
}

/// The factors from the means of a, b and ab under the window, and from σa² + σb².
#[inline(always)]
pub fn factors<R: Real>(a: R, b: R, ab: R, variances: R) -> Factors<R> {
    let c1 = R::of(C1);
    let c2 = R::of(C2);
    let two = R::of(2.0);
    Factors {
        luminance: two * a * b + c1,
        structure: two * (ab - a * b) + c2,
        means: a * a + b * b + c1,
        variances: variances + c2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    fn noise(size: UVec2, purpose: &str) -> Vec<[u8; 3]> {
        let rng = Rng::new(1, purpose, 0);
        let count = u64::from(size.x) * u64::from(size.y);
        (0..count).map(|i| [0, 1, 2].map(|c| (rng.bits(3 * i + c) >> 56) as u8)).collect()
    }

    /// SSIM straight from the paper's formula: 121 taps at every pixel, raw moments.
    fn ssim_by_definition(size: UVec2, a: &[[u8; 3]], b: &[[u8; 3]]) -> f64 {
        let w = size.x as i64;
        let h = size.y as i64;
        let g = |d: i64| (-(d * d) as f64 / 4.5).exp();
        let norm: f64 = (-5..=5).map(g).sum();
        let mut total = 0.0;
        for c in 0..3 {
            for y in 0..h {
                for x in 0..w {
                    let mut m = [0.0; 5];
                    for dy in -5..=5i64 {
                        for dx in -5..=5i64 {
                            if (0..w).contains(&(x + dx)) && (0..h).contains(&(y + dy)) {
                                let at = ((y + dy) * w + x + dx) as usize;
                                let p = f64::from(a[at][c]) / 255.0;
                                let q = f64::from(b[at][c]) / 255.0;
                                let weight = g(dx) * g(dy) / (norm * norm);
                                for (sum, v) in m.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                                    *sum += weight * v;
                                }
                            }
                        }
                    }
                    let va = m[2] - m[0] * m[0];
                    let vb = m[3] - m[1] * m[1];
                    let vab = m[4] - m[0] * m[1];
                    total += (2.0 * m[0] * m[1] + 1e-4) * (2.0 * vab + 9e-4)
                        / ((m[0] * m[0] + m[1] * m[1] + 1e-4) * (va + vb + 9e-4));
                }
            }
        }
        total / (3 * w * h) as f64
    }

    #[test]
    fn ssim_is_the_formula_of_the_paper_at_any_size() {
        for size in [(1, 1), (1, 9), (5, 3), (11, 11), (23, 17)].map(UVec2::from) {
            let a = noise(size, "a");
            let b = noise(size, "b");
            let difference = ssim(size, &a, &b, None) - ssim_by_definition(size, &a, &b);
            assert!(difference.abs() < 1e-12, "{size}: {difference}");
            assert!((ssim(size, &a, &a, None) - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn psnr_of_known_errors() {
        let black = [[0u8; 3]; 4];
        assert_eq!(psnr(&black, &black, None), 120.0);
        assert_eq!(psnr(&black, &[[255; 3]; 4], None), 0.0);
        let tenth = [[0; 3], [0; 3], [0; 3], [51, 51, 51]]; // off by a fifth in a quarter of the pixels
        assert!((psnr(&black, &tenth, None) - 20.0).abs() < 1e-9);
    }

    #[test]
    fn hidden_pixels_do_not_count() {
        let size = UVec2::new(24, 16);
        let a = noise(size, "a");
        let mut b = noise(size, "a");
        let mut weights = vec![255u8; b.len()];
        for i in 0..24 * 4 {
            b[i] = [255 - b[i][0], 0, 7];
            weights[i] = 0;
        }
        assert_eq!(psnr(&a, &b, Some(&weights)), 120.0);
        assert!(psnr(&a, &b, None) < 20.0);
        assert!(ssim(size, &a, &b, Some(&weights)) > ssim(size, &a, &b, None));
        assert!(flip(size, &a, &b, Some(&weights)) < flip(size, &a, &b, None));
        assert_eq!(psnr(&a, &b, Some(&vec![0; b.len()])), 120.0);
    }

    #[test]
    fn flip_is_zero_for_equal_pictures_and_says_when_sizes_differ() {
        let size = UVec2::new(12, 9);
        let a = noise(size, "a");
        assert_eq!(flip(size, &a, &a, None), 0.0);
        assert!(flip(size, &a, &noise(size, "b"), None) > 0.2);
        assert!(flip(size, &a, &a[1..], None).is_nan());
    }
}
