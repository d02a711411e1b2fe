//! 8-bit sRGB codes from linear light: exact, and without a power function per channel.

use std::sync::LazyLock;

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

/// A bucket holds the values that share sign, exponent and 7 bits of mantissa: 1/128 wide relative to
/// its start. Neighbouring codes lie more than that apart (0.0088 at white, more below), so a bucket
/// holds at most one step and a single comparison suffices.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::color::linear_from_srgb;

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
            let encoded = if x <= 0.003_130_8 { x * 12.92 } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
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
        assert!(TABLE.next.windows(2).all(|w| w[1] == f32::INFINITY || bucket(w[0]) < bucket(w[1])));
    }

    #[test]
    fn clamps_what_is_outside() {
        let outside = [f32::NAN, -1.0, f32::NEG_INFINITY, -0.0, 1.5, f32::INFINITY].map(srgb8_from_linear);
        assert_eq!(outside, [0, 0, 0, 0, 255, 255]);
    }
}
