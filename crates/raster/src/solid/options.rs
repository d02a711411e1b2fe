//! How the solid rasteriser draws.

use glam::UVec2;
use trisplat_scene::{Error, Result};

/// Largest number of samples along an axis of the picture: beyond it f32 cannot resolve 1/256 of a sample.
pub const MAX_SAMPLES: u32 = 1 << 15;

/// How to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolidRasterOptions {
    /// Colour behind everything, sRGB-encoded.
    pub background: [f32; 3],
    /// Samples per pixel along each axis: 1, 2 or 4.
    pub samples: u32,
    /// Depth of the near plane in units of the mesh, > 0. Depth precision does not depend on it.
    pub near: f32,
}

impl Default for SolidRasterOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], samples: 1, near: 0.01 }
    }
}

impl SolidRasterOptions {
    /// Checks the ranges, and that a picture of `size` has at most [`MAX_SAMPLES`] along each axis.
    pub fn validate(&self, size: UVec2) -> Result<()> {
        if !matches!(self.samples, 1 | 2 | 4) {
            return Err(Error::invalid("samples", self.samples, "1, 2 or 4"));
        }
        if !(self.near > 0.0 && self.near.is_finite()) {
            return Err(Error::invalid("near", self.near, "a depth above 0"));
        }
        let most = u64::from(size.max_element()) * u64::from(self.samples);
        if most > u64::from(MAX_SAMPLES) {
            let wants = format!("a picture of at most {} px a side", MAX_SAMPLES / self.samples);
            return Err(Error::invalid("samples", format!("{} on {size} px", self.samples), wants));
        }
        Ok(())
    }
}
