//! A photo for comparison: grey, small, four neighbouring pixels in one word.

use crate::camera::Camera;
use crate::image::Pixels;
use glam::UVec2;

/// Least weight of a photo's pixels that count.
const COUNTS: u8 = 128;

/// A grey picture and its camera.
#[derive(Debug)]
pub(super) struct WorkPicture {
    /// At the size of the picture.
    pub(super) camera: Camera,
    pub(super) width: usize,
    pub(super) height: usize,
    /// `[height * width]`
    pub(super) grey: Vec<u8>,
    /// The pixel, its right neighbour, the one below, and the one to the lower right, lowest byte first.
    /// `[height * width]`
    pub(super) quads: Vec<u32>,
    /// Which pixels count; `None`: all. `[height * width]`
    pub(super) mask: Option<Vec<bool>>,
}

impl WorkPicture {
    /// Of a photo by `camera`, shrunk to `size`.
    pub(super) fn new(photo: &Pixels, camera: &Camera, size: UVec2) -> Self {
        let photo = photo.downscaled(size);
        let (width, height) = (size.x as usize, size.y as usize);
        let luma = |p: &[u8; 3]| {
            ((77 * u32::from(p[0]) + 150 * u32::from(p[1]) + 29 * u32::from(p[2]) + 128) >> 8) as u8
        };
        let grey: Vec<u8> = photo.rgb.iter().map(luma).collect();
        let at = |x: usize, y: usize| u32::from(grey[y.min(height - 1) * width + x.min(width - 1)]);
        let quad = |i: usize| {
            let (x, y) = (i % width, i / width);
            at(x, y) | at(x + 1, y) << 8 | at(x, y + 1) << 16 | at(x + 1, y + 1) << 24
        };
        let quads = (0..grey.len()).map(quad).collect();
        let mask = photo.alpha.map(|alpha| alpha.iter().map(|a| *a >= COUNTS).collect());
        Self { camera: camera.resized(size), width, height, quads, mask, grey }
    }

    /// Whether a pixel counts.
    #[inline(always)]
    pub(super) fn counts(&self, pixel: usize) -> bool {
        self.mask.as_ref().is_none_or(|mask| mask[pixel])
    }
}
