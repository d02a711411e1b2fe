//! The rasteriser of Gaussian splats, forward only (Kerbl et al. 2023; Zwicker et al. 2001): projected as ellipses, blended in order of depth.
//!
//! Memory per frame: 104 bytes per Gaussian in view, 8 per Gaussian and row of tiles that it touches, and 4 per
//! Gaussian and tile for the rows that are being drawn, one per thread.

mod draw;
mod ellipse;
mod options;
#[cfg(test)]
mod oracle;
mod tile_rows;

pub use options::GaussianOptions;

use crate::soft::Frame;
use trisplat_scene::{Splats, camera::Camera};

/// What a camera sees of Gaussians; colours sRGB-encoded, as they were trained. The same bits for any number of threads.
pub fn draw(splats: &Splats, camera: &Camera, options: &GaussianOptions) -> Frame {
    draw_and_weigh(splats, camera, options, None)
}

/// The same. Adds to `weights` what each Gaussian contributes: its blending weight, summed over the pixels. `[N]`
pub fn draw_and_weigh(
    splats: &Splats,
    camera: &Camera,
    options: &GaussianOptions,
    weights: Option<&mut [f32]>,
) -> Frame {
    let projected = ellipse::all(splats, camera, options);
    let order = ellipse::front_to_back(&projected);
    let rows = tile_rows::bin(&projected, &order, camera.size);
    draw::frame(&projected, &rows, camera.size, options, weights)
}
