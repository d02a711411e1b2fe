//! Numbers, vectors, colours and metrics; nothing here depends on triangles.

pub mod color;
pub mod geometry;
pub mod lanes;
pub mod lists;
pub mod metric;
pub mod neighbours;
pub mod real;
pub mod wgsl;
