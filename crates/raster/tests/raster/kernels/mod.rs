//! Every kernel: its gradient against dual numbers, f32 against f64, lanes against f32.

#![allow(clippy::print_stderr, reason = "prints the largest error it found")]

mod cases;
mod colors;
mod precision;
mod triangles;
mod windows;
