//! The functions of this folder in WGSL, with the constants of their Rust twins.

use super::lanes::{EXP2, LOG2, SQRT_HALF_BITS};
use super::metric;
use std::fmt::{Debug, Write};

/// The functions, and all constants they need.
pub fn library() -> String {
    let mut out = String::new();
    constants(&mut out, "LOG2", &LOG2);
    constants(&mut out, "EXP2", &EXP2);
    let _ = writeln!(out, "const SQRT_HALF_BITS: i32 = {SQRT_HALF_BITS};");
    constant(&mut out, "LN_2", std::f64::consts::LN_2);
    constant(&mut out, "SSIM_C1", metric::C1);
    constant(&mut out, "SSIM_C2", metric::C2);
    constants(&mut out, "SSIM_WINDOW", &metric::window());
    out + include_str!("functions.wgsl")
}

/// Writes a number as a constant.
pub fn constant(out: &mut String, name: &str, value: impl Into<f64>) {
    // Nine digits are every f32 there is.
    let _ = writeln!(out, "const {name}: f32 = {:.9e};", value.into());
}

/// Writes numbers as a constant array.
pub fn constants<T: Copy + Into<f64> + Debug>(out: &mut String, name: &str, values: &[T]) {
    let list: Vec<String> = values.iter().map(|&value| format!("{:.9e}", value.into())).collect();
    let count = values.len();
    let list = list.join(", ");
    let _ = writeln!(out, "const {name} = array<f32, {count}>({list});");
}
