//! Numbers: knows no triangle.

pub mod color;
pub mod srgb8;
