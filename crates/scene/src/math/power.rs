//! The power of the sRGB curve, x^2.4: rounded to the nearest f32, the same on every platform, and faster than `powf`.

use std::sync::LazyLock;

/// The exponent rounded to f32, so that files stay bitwise the same.
const EXPONENT: f64 = 2.4f32 as f64;

/// The binomial coefficients of the exponent, from the first on.
const SERIES: [f64; 5] = {
    let mut series = [EXPONENT; 5];
    let mut k = 1;
    while k < series.len() {
        series[k] = series[k - 1] * (EXPONENT - k as f64) / (k + 1) as f64;
        k += 1;
    }
    series
};

/// x^2.4 for x from 1/16 to 1.
///
/// ```text
/// x = t (1 + r):  x^2.4 = t^2.4 (1 + 2.4 r + 1.68 r^2 + 0.224 r^3 - 0.0336 r^4 + 0.010752 r^5 - ...)
/// ```
///
/// with t the start of one of 128 steps per octave. So r < 2^-7, and the remainder is less than 2e-15. It is
/// computed in f64 and rounded once.
#[inline(always)]
pub(super) fn power_2_4(x: f32) -> f32 {
    debug_assert!((SMALLEST..=1.0).contains(&x), "{x}");
    let Step { inverse, power } = STEPS[((x.to_bits() - SMALLEST.to_bits()) >> STEP_SHIFT) as usize];
    let r = f64::from(x) * inverse - 1.0;
    let [c1, c2, c3, c4, c5] = SERIES;
    let series = c1 + r * (c2 + r * (c3 + r * (c4 + r * c5)));
    (power + power * (r * series)) as f32
}

/// The smallest argument.
const SMALLEST: f32 = 1.0 / 16.0;
/// Arguments of a step share sign, exponent and 7 bits of the mantissa.
const STEP_SHIFT: u32 = 23 - 7;
/// Number of steps below 1; 1 begins another.
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
    Box::new(std::array::from_fn(|i| Step { inverse: 1.0 / start(i), power: start(i).powf(EXPONENT) }))
});

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;

    /// All arguments there are.
    fn all() -> impl ParallelIterator<Item = f32> {
        (SMALLEST.to_bits()..=1.0f32.to_bits()).into_par_iter().map(f32::from_bits)
    }

    #[test]
    fn every_power_is_the_nearest_float() {
        let wrong: Vec<f32> = all().filter(|&x| power_2_4(x) != f64::from(x).powf(EXPONENT) as f32).collect();
        assert!(wrong.is_empty(), "{wrong:?}");
    }

    /// Values of glibc's `powf`; other C libraries round differently.
    #[cfg(target_env = "gnu")]
    #[test]
    fn colours_are_written_with_the_codes_that_powf_gives() {
        let code = |linear: f32, most: f64| (f64::from(linear) * most + 0.5) as u32;
        let differ =
            |most: f64| all().filter(|x| code(power_2_4(*x), most) != code(x.powf(2.4), most)).count();
        assert_eq!(differ(255.0), 0);
        // `powf` is not always the nearest value: fewer than one 16-bit code in a million differs, and ours
        // is right.
        assert!(differ(65535.0) < all().count() / 1_000_000, "{}", differ(65535.0));
    }
}
