//! The paper's formulas: pure functions, no buffers, no I/O. Each has a twin in WGSL beside it, for
//! a graphics card.

pub mod loss;
pub mod normal;
pub mod sh;
pub mod splat;
mod ssim;
pub mod window;

use trisplat_scene::math::wgsl::{self, constant};

/// The functions in WGSL, those of [`wgsl::library`], and all constants they need.
pub fn wgsl_library() -> String {
    let mut out = wgsl::library();
    constant(&mut out, "RATIO_FLOOR", window::RATIO_FLOOR);
    constant(&mut out, "MIN_COVERAGE", normal::MIN_COVERAGE);
    constant(&mut out, "BETA1", BETA1);
    constant(&mut out, "BETA2", BETA2);
    constant(&mut out, "EPS", EPS);
    for part in [
        include_str!("kernel/window.wgsl"),
        include_str!("kernel/composite.wgsl"),
        include_str!("kernel/splat.wgsl"),
        include_str!("kernel/clip.wgsl"),
        include_str!("kernel/adam.wgsl"),
        include_str!("kernel/loss.wgsl"),
    ] {
        out += part;
    }
    out + &sh::wgsl()
}

// ---- Adam (Kingma and Ba 2015) as 3DGS runs it: eps 1e-15, one rate per group, betas 0.9 and 0.999

/// Decay of the first moment.
const BETA1: f32 = 0.9;
/// Decay of the second moment.
const BETA2: f32 = 0.999;
/// Added to the root of the second moment.
const EPS: f32 = 1e-15;

/// One group's rate at one step, with the bias corrections folded in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rate {
    /// rate / (1 - β1^t).
    pub step: f32,
    /// 1 / (1 - β2^t).
    pub second: f32,
}

impl Rate {
    /// The rate `rate` at step `t` >= 1 of this optimiser.
    pub fn new(rate: f64, t: u64) -> Self {
        let t = t.clamp(1, 1_000_000) as i32;
        let first = 1.0 - f64::from(BETA1).powi(t);
        let second = 1.0 - f64::from(BETA2).powi(t);
        Self { step: (rate / first) as f32, second: (1.0 / second) as f32 }
    }

    /// `factor` times this rate.
    pub fn times(self, factor: f32) -> Self {
        Self { step: factor * self.step, ..self }
    }
}

/// Moves `values` against `gradient` and updates both moments; all slices are equally long.
///
/// ```text
/// m = β1 m + (1 - β1) g      v = β2 v + (1 - β2) g²
/// x = x - rate / (1 - β1^t) · m / (sqrt(v / (1 - β2^t)) + eps)
/// ```
#[inline(always)]
pub fn adam(
    rate: Rate,
    values: &mut [f32],
    gradient: &[f32],
    first: &mut [f32],
    second: &mut [f32],
) {
    for (((x, &g), m), v) in values.iter_mut().zip(gradient).zip(first).zip(second) {
        *m = BETA1 * *m + (1.0 - BETA1) * g;
        *v = BETA2 * *v + (1.0 - BETA2) * g * g;
        *x -= rate.step * *m / ((*v * rate.second).sqrt() + EPS);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_step_is_the_rate() {
        let mut x = [1.0, 1.0];
        let mut m = [0.0; 2];
        let mut v = [0.0; 2];
        adam(Rate::new(0.01, 1), &mut x, &[3.0, -0.0002], &mut m, &mut v);
        assert!((x[0] - 0.99).abs() < 1e-6 && (x[1] - 1.01).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn follows_the_textbook_in_f64() {
        let gradients = [0.5f64, -1.0, 0.25, 0.0, 2.0];
        let mut x = [0.0f32];
        let mut m = [0.0f32];
        let mut v = [0.0f32];
        let mut x64 = 0.0f64;
        let mut m64 = 0.0f64;
        let mut v64 = 0.0f64;
        for (i, g) in gradients.iter().enumerate() {
            let t = i as i32 + 1;
            adam(Rate::new(0.1, t as u64), &mut x, &[*g as f32], &mut m, &mut v);
            m64 = 0.9 * m64 + 0.1 * g;
            v64 = 0.999 * v64 + 0.001 * g * g;
            x64 -= 0.1 * (m64 / (1.0 - 0.9f64.powi(t)))
                / ((v64 / (1.0 - 0.999f64.powi(t))).sqrt() + 1e-15);
        }
        assert!((f64::from(x[0]) - x64).abs() < 1e-5, "{} {x64}", x[0]);
    }

    #[test]
    fn a_zero_gradient_on_fresh_moments_moves_nothing() {
        let mut x = [5.0];
        let mut m = [0.0];
        let mut v = [0.0];
        adam(Rate::new(0.1, 1), &mut x, &[0.0], &mut m, &mut v);
        assert_eq!(x[0], 5.0);
    }
}
