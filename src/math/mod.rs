//! Numbers: knows no triangle.

pub mod color;
pub mod srgb8;
pub mod metric;
