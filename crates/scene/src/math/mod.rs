//! Numbers, vectors, colours and metrics; nothing here depends on triangles.

pub mod color;
pub mod color_fit;
pub mod curve;
pub mod eigen;
pub mod evenly_spaced;
pub mod finite;
pub mod lanes;
pub mod median;
pub mod metric;
pub mod octasphere;
mod power;
pub mod real;
pub mod sets;
pub mod short;
pub mod srgb8;
pub mod ssim;
pub mod vec;
pub mod wgsl;
