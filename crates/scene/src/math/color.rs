//! sRGB transfer functions (IEC 61966-2-1), their 8-bit codes, and the affine map between two
//! pictures.

use super::real::Real;
use glam::{DMat4, DVec3, DVec4};
use std::sync::LazyLock;

/// sRGB-encoded channel in [0, 1] to linear light; values outside are clamped first.
#[inline]
pub fn linear_from_srgb(encoded: f32) -> f32 {
    let c = encoded.clamp(0.0, 1.0);
    // NaN is in no range.
    if c > 0.040_45 { power_2_4((c + 0.055) / 1.055) } else { c / 12.92 }
}

/// Linear-light channel in [0, 1] to sRGB encoding; values outside are clamped first.
pub fn srgb_from_linear(linear: f32) -> f32 {
    let c = linear.clamp(0.0, 1.0);
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
}

/// The linear light of an encoded channel >= 0 and its slope there. The curve extends beyond 1.
#[inline(always)]
pub fn decode<R: Real>(encoded: R) -> (R, R) {
    let c = R::of;
    let base = (encoded.max(c(0.040_45)) + c(0.055)) * c(1.0 / 1.055);
    let linear = (base.log2() * c(2.4)).exp2();
    let low = encoded.le(c(0.040_45));
    let slope = linear / base * c(2.4 / 1.055);
    (R::select(low, encoded * c(1.0 / 12.92), linear), R::select(low, c(1.0 / 12.92), slope))
}

/// The sRGB encoding of a linear channel >= 0 and its slope there. The curve extends beyond 1.
#[inline(always)]
pub fn encode<R: Real>(linear: R) -> (R, R) {
    let c = R::of;
    let light = linear.max(c(0.003_130_8));
    let power = (light.log2() * c(1.0 / 2.4)).exp2() * c(1.055);
    let low = linear.le(c(0.003_130_8));
    let slope = power / light * c(1.0 / 2.4);
    (R::select(low, linear * c(12.92), power - c(0.055)), R::select(low, c(12.92), slope))
}

/// The linear light of every 8-bit sRGB code: `table[code] == linear_from_srgb(code / 255)`.
pub fn linear_of_srgb8() -> &'static [f32; 256] {
    static TABLE: LazyLock<[f32; 256]> =
        LazyLock::new(|| std::array::from_fn(|code| linear_from_srgb(code as f32 / 255.0)));
    &TABLE
}

// ---- 8-bit sRGB codes from linear light: exact, and without a power function per channel --------

/// The sRGB code nearest to a linear-light channel; values outside [0, 1] are clamped, NaN is 0.
///
/// ```text
/// code = round(255 * srgb(linear)), undoing linear_from_srgb(code / 255) for all 256 codes
/// ```
#[inline]
pub fn srgb8_from_linear(linear: f32) -> u8 {
    let x = if linear > 0.0 { linear.min(1.0) } else { 0.0 };
    let table = &*TABLE;
    let code = table.bucket[(x.to_bits() >> BUCKET_SHIFT) as usize];
    code + u8::from(x >= table.next[code as usize])
}

/// A bucket holds the values that share sign, exponent and 7 bits of mantissa: 1/128 wide relative
/// to its start. Neighbouring codes lie more than that apart (0.0088 at white, more below), so a
/// bucket holds at most one step and a single comparison suffices.
const BUCKET_SHIFT: u32 = 16;
const BUCKETS: usize = (1.0f32.to_bits() >> BUCKET_SHIFT) as usize + 1;

struct CodeTable {
    /// Code at the start of each bucket.
    bucket: [u8; BUCKETS],
    /// The smallest value that has a code above this one.
    next: [f32; 256],
}

static TABLE: LazyLock<Box<CodeTable>> = LazyLock::new(|| {
    let mut next = [f32::INFINITY; 256];
    for (code, step) in next.iter_mut().take(255).enumerate() {
        *step = at_least(linear((code as f64 + 0.5) / 255.0));
    }
    let mut bucket = [0; BUCKETS];
    for (i, code) in bucket.iter_mut().enumerate() {
        let start = f32::from_bits((i as u32) << BUCKET_SHIFT);
        *code = next.partition_point(|&step| step <= start) as u8;
    }
    Box::new(CodeTable { bucket, next })
});

/// The sRGB decoding function (IEC 61966-2-1) in f64.
fn linear(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

/// The smallest f32 that is not below `x`.
fn at_least(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x { near.next_up() } else { near }
}

// ---- The power of the sRGB curve, x^2.4, rounded to the nearest f32 on every platform -----------

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
/// with t the start of one of 128 steps per octave. So r < 2^-7, and the remainder is less than
/// 2e-15. It is computed in f64 and rounded once.
#[inline(always)]
pub(super) fn power_2_4(x: f32) -> f32 {
    debug_assert!((MIN_ARGUMENT..=1.0).contains(&x), "{x}");
    let Step { inverse, power } =
        STEPS[((x.to_bits() - MIN_ARGUMENT.to_bits()) >> STEP_SHIFT) as usize];
    let r = f64::from(x) * inverse - 1.0;
    let [c1, c2, c3, c4, c5] = SERIES;
    let series = c1 + r * (c2 + r * (c3 + r * (c4 + r * c5)));
    (power + power * (r * series)) as f32
}

/// Minimum argument.
const MIN_ARGUMENT: f32 = 1.0 / 16.0;
/// Arguments of a step share sign, exponent and 7 bits of the mantissa.
const STEP_SHIFT: u32 = 23 - 7;
/// Number of steps below 1; 1 begins another.
const COUNT: usize = ((1.0f32.to_bits() - MIN_ARGUMENT.to_bits()) >> STEP_SHIFT) as usize + 1;

/// Arguments from t on.
#[derive(Clone, Copy)]
struct Step {
    /// 1 / t
    inverse: f64,
    /// t^2.4
    power: f64,
}

static STEPS: LazyLock<Box<[Step; COUNT]>> = LazyLock::new(|| {
    let start =
        |i: usize| f64::from(f32::from_bits(MIN_ARGUMENT.to_bits() + ((i as u32) << STEP_SHIFT)));
    Box::new(std::array::from_fn(|i| Step {
        inverse: 1.0 / start(i),
        power: start(i).powf(EXPONENT),
    }))
});

// ---- The affine colour map between two pictures with the least error ----------------------------

/// Weight of the identity map, as a share of the picture's weight: it determines the directions
/// that a picture of few colours leaves open.
const RIDGE: f64 = 1e-6;

/// A map of sRGB-encoded colours, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorMap {
    /// Factors of red, green, blue and 1 for each channel.
    rows: [DVec4; 3],
}

impl ColorMap {
    /// The map that brings `from` closest to `to`, by least squares. Weights per pixel, 0 to 255,
    /// exclude masked pixels; `None` weights all equally. The pictures must have the same number of
    /// pixels.
    pub fn fit(from: &[[u8; 3]], to: &[[u8; 3]], weights: Option<&[u8]>) -> Self {
        assert_eq!(from.len(), to.len(), "pictures of different sizes");
        let mut matrix = DMat4::ZERO;
        let mut right = [DVec4::ZERO; 3];
        let mut all = 0.0;
        for (i, (from, to)) in from.iter().zip(to).enumerate() {
            let weight = weights.map_or(1.0, |weights| f64::from(weights[i]) / 255.0);
            let x = encoded(*from).extend(1.0);
            let y = encoded(*to);
            let weighted = weight * x;
            matrix +=
                DMat4::from_cols(x.x * weighted, x.y * weighted, x.z * weighted, x.w * weighted);
            for c in 0..3 {
                right[c] += y[c] * weighted;
            }
            all += weight;
        }
        // Never zero: then the map changes nothing.
        let ridge = RIDGE * all.max(1.0);
        let inverse = (matrix + ridge * DMat4::IDENTITY).inverse();
        let same = [DVec4::X, DVec4::Y, DVec4::Z];
        Self { rows: [0, 1, 2].map(|c: usize| inverse * (right[c] + ridge * same[c])) }
    }

    /// A colour after the map, 0 to 1, not limited.
    pub fn color(&self, rgb: [u8; 3]) -> [f64; 3] {
        let x = encoded(rgb).extend(1.0);
        self.rows.map(|row| row.dot(x))
    }

    /// The colours of a picture after the map, rounded to 8 bits.
    pub fn of(&self, rgb: &[[u8; 3]]) -> Vec<[u8; 3]> {
        let mapped =
            |rgb: &[u8; 3]| self.color(*rgb).map(|c| (255.0 * c).round().clamp(0.0, 255.0) as u8);
        rgb.iter().map(mapped).collect()
    }
}

fn encoded(rgb: [u8; 3]) -> DVec3 {
    DVec3::from_array(rgb.map(f64::from)) / 255.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_and_slopes_agree() {
        for i in 0..=1000 {
            let x = f64::from(i) / 1000.0;
            let (linear, slope) = decode(x);
            let (back, inverse) = encode(decode(x).0);
            assert!((linear - f64::from(linear_from_srgb(x as f32))).abs() < 1e-6, "{x}");
            // The two pieces of the standard's curve agree only to seven digits where they meet.
            assert!((back - x).abs() < 1e-7 && (slope * inverse - 1.0).abs() < 1e-6, "{x}");
            let h = 1e-6;
            if (x - 0.040_45).abs() > 1e-3 {
                let difference =
                    (decode(x + h).0 - decode((x - h).max(0.0)).0) / (x + h - (x - h).max(0.0));
                assert!((difference / slope - 1.0).abs() < 1e-4, "{x}");
            }
        }
    }

    #[test]
    fn every_8_bit_code_survives_the_round_trip() {
        for code in 0..=255u32 {
            let there = linear_from_srgb(code as f32 / 255.0);
            assert_eq!((srgb_from_linear(there) * 255.0).round() as u32, code);
            assert_eq!(linear_of_srgb8()[code as usize], there);
        }
    }
}

#[cfg(test)]
mod srgb8_tests {
    use super::linear_from_srgb;
    use super::*;

    #[test]
    fn undoes_the_decoding_of_every_code() {
        for code in 0..=255u8 {
            assert_eq!(srgb8_from_linear(linear_from_srgb(f32::from(code) / 255.0)), code);
            assert_eq!(srgb8_from_linear(linear(f64::from(code) / 255.0) as f32), code);
        }
    }

    #[test]
    fn rounds_like_the_formula_in_f64_all_the_way() {
        let formula = |x: f32| {
            let x = f64::from(x);
            let encoded =
                if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
            (encoded * 255.0).round() as u8
        };
        for bits in (0..=1.0f32.to_bits()).step_by(997) {
            let x = f32::from_bits(bits);
            assert_eq!(srgb8_from_linear(x), formula(x), "{x}");
        }
        // Both sides of every step.
        for code in 0..255usize {
            let step = TABLE.next[code];
            assert_eq!(srgb8_from_linear(step), code as u8 + 1);
            assert_eq!(srgb8_from_linear(step.next_down()), code as u8);
        }
    }

    #[test]
    fn no_bucket_holds_two_steps() {
        let bucket = |x: f32| x.to_bits() >> BUCKET_SHIFT;
        assert!(
            TABLE.next.windows(2).all(|w| w[1] == f32::INFINITY || bucket(w[0]) < bucket(w[1]))
        );
    }

    #[test]
    fn clamps_what_is_outside() {
        let outside =
            [f32::NAN, -1.0, f32::NEG_INFINITY, -0.0, 1.5, f32::INFINITY].map(srgb8_from_linear);
        assert_eq!(outside, [0, 0, 0, 0, 255, 255]);
    }
}

#[cfg(test)]
mod power_tests {
    use super::*;
    use rayon::prelude::*;

    /// All arguments there are.
    fn all() -> impl ParallelIterator<Item = f32> {
        (MIN_ARGUMENT.to_bits()..=1.0f32.to_bits()).into_par_iter().map(f32::from_bits)
    }

    #[test]
    fn every_power_is_the_nearest_float() {
        let wrong: Vec<f32> =
            all().filter(|&x| power_2_4(x) != f64::from(x).powf(EXPONENT) as f32).collect();
        assert!(wrong.is_empty(), "{wrong:?}");
    }

    /// Values of glibc's `powf`; other C libraries round differently.
    #[cfg(target_env = "gnu")]
    #[test]
    fn colours_are_written_with_the_codes_that_powf_gives() {
        let code = |linear: f32, max: f64| (f64::from(linear) * max + 0.5) as u32;
        let differ =
            |max: f64| all().filter(|x| code(power_2_4(*x), max) != code(x.powf(2.4), max)).count();
        assert_eq!(differ(255.0), 0);
        // `powf` is not always the nearest value: fewer than one 16-bit code in a million differs,
        // and ours is right.
        assert!(differ(65535.0) < all().count() / 1_000_000, "{}", differ(65535.0));
    }
}

#[cfg(test)]
mod color_fit_tests {
    use super::*;
    use crate::math::metric::psnr;

    /// Colours of all kinds, none near black or white.
    fn colors() -> Vec<[u8; 3]> {
        (0..4096u32)
            .map(|i| [60 + i % 97, 60 + i / 7 % 89, 60 + i / 31 % 101].map(|c| c as u8))
            .collect()
    }

    #[test]
    fn known_gains_and_offsets_are_undone() {
        let from = colors();
        let mix = |[r, g, b]: [u8; 3]| {
            let [r, g, b] = [r, g, b].map(f64::from);
            [1.2 * r - 0.05 * g + 4.0, 0.8 * g + 0.1 * b, 0.02 * r + 1.1 * b - 9.0]
                .map(|c| c.round() as u8)
        };
        let to: Vec<[u8; 3]> = from.iter().map(|c| mix(*c)).collect();
        let map = ColorMap::fit(&from, &to, None);
        let want =
            [[1.2, -0.05, 0.0, 4.0 / 255.0], [0.0, 0.8, 0.1, 0.0], [0.02, 0.0, 1.1, -9.0 / 255.0]];
        for (row, want) in map.rows.iter().zip(want) {
            assert!((*row - DVec4::from_array(want)).abs().max_element() < 2e-3, "{row} {want:?}");
        }
        assert!(psnr(&from, &to, None) < 30.0);
        // Only the rounding of both remains.
        assert!(psnr(&map.of(&from), &to, None) > 55.0);
    }

    #[test]
    fn pixels_without_weight_do_not_count() {
        let from = colors();
        let mut to: Vec<[u8; 3]> = from.iter().map(|c| c.map(|c| c / 2)).collect();
        let mut weights = vec![255; from.len()];
        for i in (0..from.len()).step_by(3) {
            to[i] = [255, 0, 255];
            weights[i] = 0;
        }
        assert!(
            psnr(&ColorMap::fit(&from, &to, Some(&weights)).of(&from), &to, Some(&weights)) > 50.0
        );
        assert!(psnr(&ColorMap::fit(&from, &to, None).of(&from), &to, Some(&weights)) < 30.0);
    }

    #[test]
    fn one_colour_or_none_is_no_fault() {
        let map = ColorMap::fit(&[], &[], None);
        assert_eq!(map.of(&colors()), colors());
        let from = [[100, 50, 20]; 9];
        let to = [[90, 60, 20]; 9];
        assert_eq!(ColorMap::fit(&from, &to, None).of(&from), to);
        assert_eq!(ColorMap::fit(&from, &to, Some(&[0; 9])).of(&from), from);
    }
}
