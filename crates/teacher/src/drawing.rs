//! Draws a scene as it was trained.

use glam::Vec3;
use trisplat_raster::soft::{Frame, SoftOptions, SoftRasterizer, SoupRef};
use trisplat_scene::{SceneNormalization, Soup, camera::Camera, image::RgbImage};

/// Largest coordinate of a drawn triangle.
const REACH: f32 = 1e15;

/// Draws one scene for many cameras.
#[derive(Debug)]
pub struct Teacher {
    soup: Soup,
    space: SceneNormalization,
    options: SoftOptions,
    soft: SoftRasterizer,
}

impl Teacher {
    /// Draws `soup` with `options` for `cameras` in its frame and others near them. Lengths in `options` are
    /// in units of training space.
    pub fn new(mut soup: Soup, cameras: &[Camera], options: &SoftOptions) -> Self {
        let drawn = |corners: &[Vec3; 3]| corners.iter().all(|v| v.abs().max_element() < REACH);
        if !soup.vertices.iter().all(drawn) {
            let keep: Vec<bool> = soup.vertices.iter().map(drawn).collect();
            soup.retain(|i| keep[i]);
        }
        let centers: Vec<Vec3> = soup.vertices.iter().map(|[a, b, c]| (*a + *b + *c) / 3.0).collect();
        let space = SceneNormalization::new(cameras, &centers);
        space.soup_to_training(&mut soup);
        let options = options.with_cap_for(&soup.opacity);
        Self { soup, space, options, soft: SoftRasterizer::new() }
    }

    /// Units of the soup in a unit of a frame's depths.
    pub fn depth_unit(&self) -> f32 {
        1.0 / self.space.scale
    }

    /// The view of `camera`, in the frame of the soup.
    pub fn frame(&mut self, camera: &Camera) -> &Frame {
        let camera = self.space.camera_to_training(camera);
        self.soft.render(&SoupRef::from(&self.soup), &camera, &self.options)
    }

    /// The picture that `camera` takes.
    pub fn picture(&mut self, camera: &Camera) -> RgbImage {
        self.frame(camera).to_pixels()
    }

    /// The picture of `camera`, with the covered share of each pixel as its weight.
    pub fn weighted_picture(&mut self, camera: &Camera) -> RgbImage {
        let frame = self.frame(camera);
        let cover = |t: &f32| ((1.0 - t).clamp(0.0, 1.0) * 255.0).round() as u8;
        let alpha: Vec<u8> = frame.transmittance.iter().map(cover).collect();
        let covered = alpha.iter().all(|a| *a == 255);
        RgbImage { alpha: (!covered).then_some(alpha), ..frame.to_pixels() }
    }
}
