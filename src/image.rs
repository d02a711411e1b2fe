//! Pictures in memory.

use glam::UVec2;

/// An RGB picture, sRGB-encoded, values usually in [0, 1].
#[derive(Debug, Clone, PartialEq)]
pub struct Image {
    /// Width and height, px.
    pub size: UVec2,
    /// Rows from the top. // [H * W]
    pub pixels: Vec<[f32; 3]>,
}
