//! SSIM (Wang et al. 2004) with the conventions of 3DGS, shared by the loss and the metric.
//!
//! ```text
//! ssim = (2 μa μb + C1) (2 σab + C2) / ((μa² + μb² + C1) (σa² + σb² + C2))
//! ```
//! Moments are taken under an 11x11 Gaussian window of deviation 1.5 px, zeros outside the picture; values are in
//! [0, 1].

use crate::math::real::Real;

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
    let (c1, c2, two) = (R::of(C1), R::of(C2), R::of(2.0));
    Factors {
        luminance: two * a * b + c1,
        structure: two * (ab - a * b) + c2,
        means: a * a + b * b + c1,
        variances: variances + c2,
    }
}
