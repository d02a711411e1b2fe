//! A development program: what trisplat costs and how exact it is, and the samples that tests and
//! docs use.
//!
//! In: a machine, scenes, photos. Out: tables of cost and accuracy, synthetic scenes.

#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program that prints tables")]

mod bake;
pub mod cli;
mod cost;
#[cfg(feature = "gpu")]
mod fps;
mod machine;
pub mod stress;
