//! Draws Gaussian splats for many cameras, which are in the frame of their file.

use trisplat_raster::gaussian::{self, GaussianOptions};
use trisplat_scene::{
    Splats,
    camera::Camera,
    image::{Image, RgbImage},
};

/// Gaussians and how they are drawn.
#[derive(Debug)]
pub struct SplatsRenderer {
    splats: Splats,
    options: GaussianOptions,
}

impl SplatsRenderer {
    /// A renderer over a background, sRGB-encoded.
    pub fn new(splats: Splats, background: [f32; 3]) -> Self {
        let options = GaussianOptions::suited_to(&splats, background);
        Self { splats, options }
    }

    /// What the camera sees.
    pub fn color(&self, camera: &Camera) -> RgbImage {
        gaussian::draw(&self.splats, camera, &self.options).to_pixels()
    }

    /// The same before it is rounded to 8 bits, sRGB-encoded.
    pub fn image(&self, camera: &Camera) -> Image {
        let frame = gaussian::draw(&self.splats, camera, &self.options);
        Image { size: frame.size, pixels: frame.rgb }
    }
}
