//! Draws Gaussian splats for many cameras, which are in the frame of their file.

use glam::DVec3;
use trisplat_raster::gaussian::{self, GaussianOptions};
use trisplat_scene::{
    Splats,
    camera::Camera,
    image::{Image, RgbImage},
};

/// Depth of the near plane in units of the scene's size, for scenes so small that the usual depth would cut into them.
const NEAR_PER_SIZE: f64 = 0.01;

/// Gaussians and how they are drawn.
#[derive(Debug)]
pub struct SplatsRenderer {
    splats: Splats,
    options: GaussianOptions,
}

impl SplatsRenderer {
    /// A renderer over a background, sRGB-encoded.
    pub fn new(splats: Splats, background: [f32; 3]) -> Self {
        let usual = GaussianOptions::default().near;
        let near = usual.min((size_of(&splats) * NEAR_PER_SIZE) as f32).max(f32::MIN_POSITIVE);
        Self { splats, options: GaussianOptions { background, near } }
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

/// Mean distance of the Gaussians from their middle.
fn size_of(splats: &Splats) -> f64 {
    let count = splats.len().max(1) as f64;
    let middle = splats.positions.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / count;
    splats.positions.iter().map(|p| p.as_dvec3().distance(middle)).sum::<f64>() / count
}
