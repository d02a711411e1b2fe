//! Draws a scene as it was trained.

use glam::Vec3;
use trisplat_raster::soft::{Frame, FrameGrad, Importance, SoftOptions, SoftRasterizer, SoupGrad, SoupRef};
use trisplat_scene::{SceneNormalization, Soup, camera::Camera, image::RgbImage};

/// Largest coordinate of a drawn triangle.
const REACH: f32 = 1e15;

/// Cover of a pixel that counts as none; without as much, it counts as covered.
const HAZE: f32 = 0.2;

/// The least alpha with which a colour over the one `behind` it can be seen as `over`.
fn least_alpha(over: &[f32; 3], behind: &[f32; 3]) -> f32 {
    let least = |(over, behind): (&f32, &f32)| match over - behind {
        more if more > 0.0 => more / (1.0 - behind),
        less if less < 0.0 => less / -behind,
        _ => 0.0,
    };
    over.iter().zip(behind).map(least).fold(0.0, f32::max).min(1.0)
}

/// True for a triangle that is near enough to be drawn.
pub(super) fn is_drawn(corners: &[Vec3; 3]) -> bool {
    corners.iter().all(|v| v.abs().max_element() < REACH)
}

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
        if !soup.vertices.iter().all(is_drawn) {
            let keep: Vec<bool> = soup.vertices.iter().map(is_drawn).collect();
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

    /// The picture of an object from `camera`, over black, with alpha. It is transparent where the picture shows the
    /// colour `behind`, and over that colour it is the picture.
    pub fn object_picture(&mut self, camera: &Camera, behind: [f32; 3]) -> RgbImage {
        let own = self.options.background;
        let frame = self.frame(camera);
        let pixels = frame.rgb.iter().zip(&frame.transmittance).map(|(rgb, through)| {
            let over = [0, 1, 2].map(|c| (rgb[c] + through * (behind[c] - own[c])).clamp(0.0, 1.0));
            // A soft scene leaks a little where it is opaque, and has a haze where it is empty.
            let clear = ((1.0 - through - HAZE) / (1.0 - 2.0 * HAZE)).clamp(0.0, 1.0);
            let alpha = least_alpha(&over, &behind).max(clear);
            ([0, 1, 2].map(|c| over[c] - (1.0 - alpha) * behind[c]), alpha)
        });
        let (rgb, alpha): (Vec<[f32; 3]>, Vec<f32>) = pixels.unzip();
        let alpha = alpha.iter().map(|alpha| (alpha * 255.0).round() as u8).collect();
        RgbImage { alpha: Some(alpha), ..RgbImage::from_rgb(frame.size, &rgb) }
    }

    /// The picture of `camera`, with the covered share of each pixel as its weight.
    pub fn weighted_picture(&mut self, camera: &Camera) -> RgbImage {
        self.frame(camera).to_cut_pixels()
    }

    /// For each triangle, the mean of `values` of the pixels of all pictures, by its blending weight there; 1 for
    /// a triangle that no camera sees. `[N]`
    pub(super) fn shares(&mut self, cameras: &[Camera], values: &[Vec<f32>]) -> Vec<f32> {
        let (soup, options) = (SoupRef::from(&self.soup), SoftOptions { importance: true, ..self.options });
        let (mut weights, mut sums) = (Importance::new(soup.len()), vec![0.0; soup.len()]);
        let mut of_picture = SoupGrad::default();
        for (camera, values) in cameras.iter().zip(values) {
            let camera = self.space.camera_to_training(camera);
            self.soft.render(&soup, &camera, &options);
            self.soft.accumulate_importance(&mut weights);
            let d_rgb = vec![[0.0; 3]; values.len()];
            let values = FrameGrad { d_rgb, error: values.clone(), ..FrameGrad::default() };
            self.soft.backward(&soup, &camera, &options, &values, &mut of_picture);
            sums.iter_mut().zip(&of_picture.error).for_each(|(sum, value)| *sum += value);
        }
        let share = |(sum, weight): (&f32, &f32)| if *weight > 0.0 { sum / weight } else { 1.0 };
        sums.iter().zip(&weights.sum_weight).map(share).collect()
    }
}
