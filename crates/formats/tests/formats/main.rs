//! Readers and writers of every format: round trips, odd but legal files, real files, bad input.

#![allow(clippy::print_stderr)] // what is skipped

mod bad;
mod files;
mod gaussians;
mod gltf;
mod gltf_read;
mod kinds;
mod mesh_ply;
mod obj;
mod off;
mod pictures;
mod pt;
mod real;
mod soup_ply;
mod splats;
mod tileset;
mod usdz;
