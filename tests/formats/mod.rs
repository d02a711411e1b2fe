//! Readers and writers of PLY, OFF and OBJ: round trips, odd but legal files, real files, bad
//! input.

#![allow(clippy::print_stderr)] // what is skipped

mod bad;
mod far;
mod files;
mod gaussians;
mod mesh_ply;
mod mutants;
mod obj;
mod off;
mod page;
mod pictures;
mod real;
mod soup_ply;
mod splats;
mod tileset;
mod usdz;
