//! How close a scene comes to the held-out photos, while it trains.

use crate::camera::Camera;
use crate::dataset::View;
use crate::error::Result;
use crate::image::Pixels;
use crate::math::color::linear_from_srgb;
use crate::math::metric;
use crate::mesh::{Colors, Mesh};
use crate::raster::soft::{Soft, SoftOptions, SoupRef, Window};
use crate::raster::solid::{Solid, SolidRasterOptions};
use crate::soup::{Soup, rgb_from_sh0};
use crate::space::Space;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Samples per pixel along each axis wherever solid drawings are compared with photos.
pub const SOLID_SAMPLES: u32 = 4;

/// How close a picture comes to a photo, both in 8 bits.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Quality {
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
    /// Structural similarity in the convention of 3DGS.
    pub ssim: f64,
}

impl Quality {
    /// Compares `picture` with `photo`, of the same size; the photo's alpha says how much each pixel counts.
    pub fn of(picture: &Pixels, photo: &Pixels) -> Self {
        let weights = photo.alpha.as_deref();
        Self {
            psnr: metric::psnr(&picture.rgb, &photo.rgb, weights),
            ssim: metric::ssim(picture.size, &picture.rgb, &photo.rgb, weights),
        }
    }

    /// Means over photos; `None` of none.
    pub fn mean(scores: &[PhotoScore]) -> Option<Self> {
        let n = scores.len() as f64;
        let sum = scores.iter().fold((0.0, 0.0), |sum, s| (sum.0 + s.psnr, sum.1 + s.ssim));
        (!scores.is_empty()).then(|| Self { psnr: sum.0 / n, ssim: sum.1 / n })
    }
}

/// How close a picture comes to a held-out photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PhotoScore {
    /// The photo.
    pub name: String,
    /// PSNR of the 8-bit picture, dB.
    pub psnr: f64,
    /// SSIM of the 8-bit picture, 3DGS's convention.
    pub ssim: f64,
}

/// Draws held-out photos, which are decoded once, and compares.
#[derive(Debug, Default)]
pub struct Evaluator {
    photos: Vec<HeldOut>,
    soft: Soft,
}

#[derive(Debug)]
struct HeldOut {
    name: String,
    camera: Camera,
    pixels: Arc<Pixels>,
}

impl Evaluator {
    /// Decodes the photos of `views`.
    pub fn new<'a>(views: impl Iterator<Item = &'a View>) -> Result<Self> {
        let photos = views
            .map(|v| {
                Ok(HeldOut { name: v.name.clone(), camera: v.camera, pixels: Arc::new(v.photo.decode()?) })
            })
            .collect::<Result<_>>()?;
        Ok(Self { photos, soft: Soft::new() })
    }

    /// True when no photo is held out.
    pub fn is_empty(&self) -> bool {
        self.photos.is_empty()
    }

    /// Draws every photo of a soup of the world; in training space, where f32 has digits to spare.
    pub fn pictures(&mut self, soup: &Soup, space: &Space, options: &SoftOptions) -> Vec<Pixels> {
        let mut soup = soup.clone();
        space.soup_to_training(&mut soup);
        let cameras = self.photos.iter().map(|photo| space.camera_to_training(&photo.camera));
        if let Some(samples) = solid_samples(options) {
            return solid_pictures(soup, cameras, options, samples);
        }
        let soup = SoupRef::from(&soup);
        cameras.map(|camera| self.soft.render(&soup, &camera, options).to_pixels()).collect()
    }

    /// Compares the [`Evaluator::pictures`] with their photos.
    pub fn scores(&self, pictures: &[Pixels]) -> Vec<PhotoScore> {
        let score = |(picture, photo): (&Pixels, &HeldOut)| {
            let Quality { psnr, ssim } = Quality::of(picture, &photo.pixels);
            PhotoScore { name: photo.name.clone(), psnr, ssim }
        };
        pictures.iter().zip(&self.photos).map(score).collect()
    }
}

/// Samples per pixel along each axis of a scene that is trained with `options`, where it is drawn solid to be compared.
pub(super) fn solid_samples(options: &SoftOptions) -> Option<u32> {
    matches!(options.window, Window::Coverage { .. }).then_some(SOLID_SAMPLES)
}

/// Draws a solid soup in training space as an engine does.
fn solid_pictures(
    mut soup: Soup,
    cameras: impl Iterator<Item = Camera>,
    options: &SoftOptions,
    samples: u32,
) -> Vec<Pixels> {
    soup.truncate_sh(0);
    let light = |sh: &[f32; 3]| sh.map(|c| linear_from_srgb(rgb_from_sh0(c)));
    let mesh = Mesh {
        positions: soup.vertices.into_flattened(),
        colors: Colors::Face(soup.sh.iter().map(light).collect()),
        ..Mesh::default()
    };
    let drawing = SolidRasterOptions { background: options.background, samples, near: options.near };
    let mut solid = Solid::new();
    cameras.map(|camera| solid.render(&mesh, &camera, &drawing)).collect()
}
