//! The power of the sRGB curve, x^2.4: rounded to the nearest f32, the same on every platform, and several times as fast as `powf`.

use std::sync::LazyLock;

/// x^2.4 for x from 1/16 to 1.
///
/// ```text
/// x = t (1 + r):  x^2.4 = t^2.4 (1 + 2.4 r + 1.68 r^2 + 0.224 r^3 - 0.0336 r^4 + 0.010752 r^5 - ...)
/// ```
///
/// with t the start of one of 128 steps per octave, so that r < 2^-7 and what follows the last term is less than 3e-15. In f64, so that one
/// rounding is left.
#[inline(always)]
pub(super) fn power_2_4(x: f32) -> f32 {
    debug_assert!((SMALLEST..=1.0).contains(&x), "{x}");
    let Step { inverse, power } = STEPS[((x.to_bits() - SMALLEST.to_bits()) >> STEP_SHIFT) as usize];
    let r = f64::from(x) * inverse - 1.0;
    let series = 2.4 + r * (1.68 + r * (0.224 + r * (-0.0336 + r * 0.010_752)));
    (power + power * (r * series)) as f32
}

/// The smallest argument.
const SMALLEST: f32 = 1.0 / 16.0;
/// Arguments of a step share sign, exponent and 7 bits of the mantissa.
const STEP_SHIFT: u32 = 23 - 7;
/// Steps up to 1, which begins one more.
const COUNT: usize = ((1.0f32.to_bits() - SMALLEST.to_bits()) >> STEP_SHIFT) as usize + 1;

/// Arguments from t on.
#[derive(Clone, Copy)]
struct Step {
    /// 1 / t
    inverse: f64,
    /// t^2.4
    power: f64,
}

static STEPS: LazyLock<Box<[Step; COUNT]>> = LazyLock::new(|| {
    let start = |i: usize| f64::from(f32::from_bits(SMALLEST.to_bits() + ((i as u32) << STEP_SHIFT)));
    Box::new(std::array::from_fn(|i| Step { inverse: 1.0 / start(i), power: start(i).powf(2.4) }))
});

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    #[test]
    fn every_power_is_the_nearest_float() {
        // All of them: that is also the proof that no colour is written with another code than by the formula in f64.
        let wrong = (SMALLEST.to_bits()..=1.0f32.to_bits()).into_par_iter().map(f32::from_bits);
        let wrong: Vec<f32> = wrong.filter(|&x| power_2_4(x) != f64::from(x).powf(2.4) as f32).collect();
        // Two numbers of 53 bits may round to neighbours where they lie beside the middle of two floats.
        let far = |x: &&f32| {
            let exact = f64::from(**x).powf(2.4);
            let near = power_2_4(**x);
            (f64::from(near) - exact).abs() > 0.5 * f64::from(near.next_up() - near) * (1.0 + 1e-6)
        };
        assert_eq!(wrong.iter().find(far), None);
        assert!(wrong.len() <= 4, "{wrong:?}");
    }
}
