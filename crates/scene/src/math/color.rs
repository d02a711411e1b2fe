//! sRGB transfer functions (IEC 61966-2-1).

use super::power::power_2_4;
use crate::math::real::Real;
use std::sync::LazyLock;

/// sRGB-encoded channel in [0, 1] to linear light; values outside are clamped first.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_and_slopes_agree() {
        for i in 0..=1000 {
            let x = f64::from(i) / 1000.0;
            let ((linear, slope), (back, inverse)) = (decode(x), encode(decode(x).0));
            assert!((linear - f64::from(linear_from_srgb(x as f32))).abs() < 1e-6, "{x}");
            // The two pieces of the standard's curve agree only to seven digits where they meet.
            assert!((back - x).abs() < 1e-7 && (slope * inverse - 1.0).abs() < 1e-6, "{x}");
            let h = 1e-6;
            if (x - 0.040_45).abs() > 1e-3 {
                let difference = (decode(x + h).0 - decode((x - h).max(0.0)).0) / (x + h - (x - h).max(0.0));
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
