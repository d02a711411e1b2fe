//! What trains a scene on the CPU: kernels, rasterisers, runs.

mod common;
mod kernels;
mod raster;
mod train;
