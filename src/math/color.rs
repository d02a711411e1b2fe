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

/// Nearest 8-bit sRGB code of a linear-light channel; NaN gives 0. Equal to rounding
/// `255 * srgb_from_linear(linear)`, without the power.
pub fn srgb8_from_linear(linear: f32) -> u8 {
    let linear = linear.clamp(0.0, 1.0);
    let table: &Srgb8 = &SRGB8;
    let mut code = table.guess[(linear * CELLS as f32) as usize];
    while linear >= table.upper[code as usize] {
        code += 1;
    }
    code
}

const CELLS: usize = 4096;

/// A first guess per 1/4096 of linear light, and where each code gives way to the next.
struct Srgb8 {
    guess: [u8; CELLS + 1],
    upper: [f32; 256],
}

static SRGB8: LazyLock<Srgb8> = LazyLock::new(|| {
    let mut upper = [f32::INFINITY; 256];
    for (code, bound) in upper.iter_mut().take(255).enumerate() {
        *bound = linear_from_srgb((code as f32 + 0.5) / 255.0);
    }
    // The guess is the code at the cell's lower end, so the search only ever walks upwards.
    let guess = std::array::from_fn(|cell| {
        let lower = cell as f32 / CELLS as f32;
        upper.iter().position(|bound| lower < *bound).unwrap_or(255) as u8
    });
    Srgb8 { guess, upper }
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_8_bit_code_survives_the_round_trip() {
        for code in 0..=255u32 {
            let there = linear_from_srgb(code as f32 / 255.0);
            assert_eq!((srgb_from_linear(there) * 255.0).round() as u32, code);
            assert_eq!(linear_of_srgb8()[code as usize], there);
            assert_eq!(srgb8_from_linear(there) as u32, code);
        }
    }

    #[test]
    fn the_table_rounds_as_the_formula_does() {
        for step in 0..=1_000_000 {
            let linear = step as f32 / 1e6;
            let exact = 255.0 * srgb_from_linear(linear);
            let error = (srgb8_from_linear(linear) as f32 - exact).abs();
            assert!(error <= 0.5001, "{linear}: {exact} became {}", srgb8_from_linear(linear));
        }
        assert_eq!([-1.0, 2.0, f32::NAN].map(srgb8_from_linear), [0, 255, 0]);
    }
}
