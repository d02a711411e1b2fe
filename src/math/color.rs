//! sRGB transfer functions (IEC 61966-2-1).

use std::sync::LazyLock;

/// sRGB-encoded channel in [0, 1] to linear light; values outside are clamped first.
pub fn linear_from_srgb(encoded: f32) -> f32 {
    let c = encoded.clamp(0.0, 1.0);
    if c <= 0.040_45 { c / 12.92 } else { ((c + 0.055) / 1.055).powf(2.4) }
}

/// Linear-light channel in [0, 1] to sRGB encoding; values outside are clamped first.
pub fn srgb_from_linear(linear: f32) -> f32 {
    let c = linear.clamp(0.0, 1.0);
    if c <= 0.003_130_8 { c * 12.92 } else { 1.055 * c.powf(1.0 / 2.4) - 0.055 }
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
    fn every_8_bit_code_survives_the_round_trip() {
        for code in 0..=255u32 {
            let there = linear_from_srgb(code as f32 / 255.0);
            assert_eq!((srgb_from_linear(there) * 255.0).round() as u32, code);
            assert_eq!(linear_of_srgb8()[code as usize], there);
        }
    }
}
