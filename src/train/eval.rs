//! How good a scene is on the held-out photos, while it trains.

use super::space::Space;
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
use std::sync::Arc;

/// Photos to be judged on, decoded once.
#[derive(Debug, Default)]
pub struct Judge {
    shots: Vec<(String, Camera, Arc<Pixels>)>,
    soft: Soft,
}

/// How close one picture comes to its photo.
#[derive(Debug, Clone, PartialEq, serde::Serialize)]
pub struct Score {
    /// The photo.
    pub name: String,
    /// PSNR of the 8-bit picture, dB.
    pub psnr: f64,
    /// SSIM of the 8-bit picture, 3DGS's convention.
    pub ssim: f64,
}

impl Judge {
    /// Decodes the photos of `views`.
    pub fn new<'a>(views: impl Iterator<Item = &'a View>) -> Result<Self> {
        let shots = views
            .map(|v| Ok((v.name.clone(), v.camera, Arc::new(v.photo.decode()?))))
            .collect::<Result<_>>()?;
        Ok(Self { shots, soft: Soft::new() })
    }

    /// True when there is nothing to judge on.
    pub fn is_empty(&self) -> bool {
        self.shots.is_empty()
    }

    /// Draws every photo of a soup of the world; in training space, where f32 has digits to spare.
    pub fn pictures(&mut self, soup: &Soup, space: &Space, options: &SoftOptions) -> Vec<(String, Pixels)> {
        let mut soup = soup.clone();
        space.enter_soup(&mut soup);
        if matches!(options.window, Window::Coverage { .. }) {
            return self.solid_pictures(soup, space, options);
        }
        let soft = &mut self.soft;
        let draw = |(name, camera, _): &(String, Camera, Arc<Pixels>)| {
            let camera = space.enter_camera(camera);
            let frame = soft.render(&SoupRef::from(&soup), &camera, options);
            (name.clone(), to_pixels(frame))
        };
        self.shots.iter().map(draw).collect()
    }

    /// Draws every photo of a solid soup in training space as an engine does, with 4 x 4 samples a pixel.
    fn solid_pictures(
        &mut self,
        mut soup: Soup,
        space: &Space,
        options: &SoftOptions,
    ) -> Vec<(String, Pixels)> {
        soup.truncate_sh(0);
        let light = |sh: &[f32; 3]| sh.map(|c| linear_from_srgb(rgb_from_sh0(c)));
        let mesh = Mesh {
            positions: soup.vertices.into_flattened(),
            colors: Colors::Face(soup.sh.iter().map(light).collect()),
            ..Mesh::default()
        };
        let drawing = SolidRasterOptions { background: options.background, samples: 4, near: options.near };
        let mut solid = Solid::new();
        let mut draw = |(name, camera, _): &(String, Camera, Arc<Pixels>)| {
            (name.clone(), solid.render(&mesh, &space.enter_camera(camera), &drawing))
        };
        self.shots.iter().map(&mut draw).collect()
    }

    /// Judges pictures of [`Judge::pictures`].
    pub fn scores(&self, pictures: &[(String, Pixels)]) -> Vec<Score> {
        let judge = |((name, drawn), (_, _, photo)): (&(String, Pixels), &(String, Camera, Arc<Pixels>))| {
            let weights = photo.alpha.as_deref();
            Score {
                name: name.clone(),
                psnr: metric::psnr(&drawn.rgb, &photo.rgb, weights),
                ssim: metric::ssim(drawn.size, &drawn.rgb, &photo.rgb, weights),
            }
        };
        pictures.iter().zip(&self.shots).map(judge).collect()
    }
}

fn to_pixels(frame: &crate::raster::soft::Frame) -> Pixels {
    let code = |c: f32| (c.clamp(0.0, 1.0) * 255.0).round() as u8;
    Pixels { size: frame.size, rgb: frame.rgb.iter().map(|p| p.map(code)).collect(), alpha: None }
}

/// Mean PSNR and SSIM; `None` of nothing.
pub fn mean(scores: &[Score]) -> Option<(f64, f64)> {
    let n = scores.len() as f64;
    let sum = scores.iter().fold((0.0, 0.0), |sum, s| (sum.0 + s.psnr, sum.1 + s.ssim));
    (!scores.is_empty()).then(|| (sum.0 / n, sum.1 / n))
}
