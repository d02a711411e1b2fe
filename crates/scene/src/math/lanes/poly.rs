//! Minimax polynomials (Remez) of the two transcendental functions the window needs.
#![allow(clippy::excessive_precision, reason = "the digits the fit gave")]

/// log2(1 + t) / t on [sqrt(1/2) - 1, sqrt(2) - 1], relative error 1.7e-7 before rounding; lowest first.
/// The factor t keeps the *relative* error small near 1, where a window with a large exponent needs it.
pub(in crate::math) const LOG2: [f32; 8] = [
    1.442_694_962,
    -0.721_352_788_1,
    0.480_923_242_3,
    -0.360_239_639_7,
    0.287_098_699_6,
    -0.248_876_864_5,
    0.234_042_370_6,
    -0.145_811_689_8,
];

/// 2^x on [-1/2, 1/2], relative error 7.5e-8 before rounding; lowest first.
pub(in crate::math) const EXP2: [f32; 6] =
    [1.000_000_072, 0.693_146_967_1, 0.240_221_197_2, 0.055_507_132_74, 0.009_675_541_333, 0.001_327_647_198];

/// Bits of sqrt(1/2): subtracting them from a number's bits leaves the exponent of its mantissa in
/// [sqrt(1/2), sqrt(2)) in the top nine bits.
pub(in crate::math) const SQRT_HALF_BITS: i32 = 0x3f35_04f3;
