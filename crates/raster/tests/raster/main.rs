//! The rasterisers. Soft: whole frames and gradients against the brute-force oracle, the same bits
//! for any number of threads, hostile scenes. Solid: against a ray caster in double precision.

#![allow(clippy::print_stderr, reason = "prints the largest error it found")]

mod compare;
mod determinism;
mod frames;
mod gaussian;
mod gradients;
mod hostile;
mod kernels;
mod scenes;
mod solid;
