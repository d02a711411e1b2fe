//! Numbers the kernels share.
#![allow(clippy::excessive_precision, reason = "as published")]

/// Smallest window ratio that is drawn. A solid triangle (σ towards 0) loses a rim of this fraction of its inradius;
/// in exchange no logarithm or quotient of a ratio can overflow.
pub const RATIO_FLOOR: f64 = 1.0 / 1_048_576.0;

/// ln 2.
pub const LN_2: f64 = std::f64::consts::LN_2;

/// Real spherical harmonics, degree 0: 1 / (2 sqrt(pi)).
pub const SH_C0: f64 = 0.282_094_791_773_878_14;
/// Degree 1: sqrt(3 / (4 pi)).
pub const SH_C1: f64 = 0.488_602_511_902_919_9;
/// Degree 2: xy, yz, 3z²-1, xz, x²-y².
pub const SH_C2: [f64; 5] = [
    1.092_548_430_592_079_2,
    -1.092_548_430_592_079_2,
    0.315_391_565_252_520_05,
    -1.092_548_430_592_079_2,
    0.546_274_215_296_039_6,
];
/// Degree 3: y(3x²-y²), xyz, y(5z²-1), z(5z²-3), x(5z²-1), z(x²-y²), x(x²-3y²).
pub const SH_C3: [f64; 7] = [
    -0.590_043_589_926_643_5,
    2.890_611_442_640_554,
    -0.457_045_799_464_465_74,
    0.373_176_332_590_115_4,
    -0.457_045_799_464_465_74,
    1.445_305_721_320_277,
    -0.590_043_589_926_643_5,
];
