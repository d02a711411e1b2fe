//! What trains a scene on the CPU: kernels, rasterisers, runs.

mod common;
mod kernels;
mod raster;
#[path = "common/skip.rs"]
mod skip;
mod train;
