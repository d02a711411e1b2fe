//! How close pictures come: to the held-out photos, and to those of the exact answer.

use crate::camera::Camera;
use crate::dataset::{Dataset, DatasetOptions, View};
use crate::error::{Error, Result};
use crate::eval::evaluate::{self, Scores};
use crate::eval::steps::{self, EvalStep};
use crate::formats::{self, ReadOptions};
use crate::image::Pixels;
use crate::limits::Limits;
use crate::math::color::{linear_from_srgb, srgb_from_linear};
use crate::render::scene_renderer::{RenderMode, RenderOptions, SceneRenderer};
use crate::train::eval::SOLID_SAMPLES;
use glam::UVec2;
use std::path::Path;

/// Draws scenes for the held-out photos and measures them.
#[derive(Debug)]
pub(super) struct Scorer<'a> {
    pub(super) dataset: &'a Dataset,
    pub(super) views: Vec<&'a View>,
    options: &'a DatasetOptions,
}

/// A scene's pictures, and how close they come to the photos.
#[derive(Debug, Clone)]
pub(super) struct Scored {
    pub(super) triangles: u64,
    pub(super) mean: Scores,
    /// In order of the held-out photos.
    pub(super) pictures: Vec<Pixels>,
}

impl<'a> Scorer<'a> {
    /// Errors: no held-out photos.
    pub(super) fn new(dataset: &'a Dataset, options: &'a DatasetOptions) -> Result<Self> {
        let views: Vec<&View> = dataset.test().collect();
        if views.is_empty() {
            let wants = "held-out photos; see `test_every`";
            return Err(Error::invalid("dataset", dataset.path.display(), wants));
        }
        Ok(Self { dataset, views, options })
    }

    pub(super) fn background(&self) -> [f32; 3] {
        self.options.background.to_f32()
    }

    /// The first held-out photo.
    pub(super) fn photo(&self) -> Result<Pixels> {
        self.views[0].photo.decode()
    }

    /// A soup or a file as an engine draws it.
    pub(super) fn solid(&self, path: &Path) -> Result<Scored> {
        let options = RenderOptions { mode: Some(RenderMode::Solid), ssaa: SOLID_SAMPLES };
        let loaded = formats::read(path, &ReadOptions::with_degree(0))?;
        let steps = steps::steps(path, loaded, &options, self.dataset, self.background())?;
        self.score(steps)
    }

    /// What a renderer draws; `triangles` is their number.
    pub(super) fn renderer(&self, renderer: SceneRenderer, triangles: u64) -> Result<Scored> {
        self.score(vec![EvalStep { name: "draw", triangles, bytes: None, renderer }])
    }

    fn score(&self, mut steps: Vec<EvalStep>) -> Result<Scored> {
        let mut pictures = Vec::new();
        let keep = |_: &View, _: &Pixels, drawn: &[evaluate::ScoredPicture]| {
            pictures.extend(drawn.iter().map(|one| one.picture.clone()));
            Ok(())
        };
        let scores = evaluate::evaluate(&mut steps, &self.views, self.options.photo_bytes(), &[], false, keep)?;
        let score = scores.first().ok_or_else(|| Error::invalid("dataset", "no score", "photos"))?;
        Ok(Scored { triangles: score.triangles, mean: score.mean, pictures })
    }

    /// The pictures of a solid scene with 64 samples per pixel: drawn twice as large with 4 × 4, and averaged in linear
    /// light, as the rasteriser averages.
    pub(super) fn exact_solid(&self, mut renderer: SceneRenderer) -> Result<Vec<Pixels>> {
        let picture = |view: &&View| {
            let camera = view.camera;
            let twice = Camera {
                focal: 2.0 * camera.focal,
                center: 2.0 * camera.center,
                size: 2 * camera.size,
                ..camera
            };
            renderer.validate(twice.size, &Limits::DEFAULT)?;
            Ok(halved(&renderer.color(&twice)))
        };
        self.views.iter().map(picture).collect()
    }
}

/// Every pixel is the average of four, in linear light.
fn halved(picture: &Pixels) -> Pixels {
    let size = picture.size / 2;
    let at = |x: u32, y: u32| picture.rgb[(y * picture.size.x + x) as usize];
    let pixel = |i: u32| {
        let corner = 2 * UVec2::new(i % size.x, i / size.x);
        let four = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| at(corner.x + x, corner.y + y));
        [0, 1, 2].map(|c| {
            let sum: f32 = four.iter().map(|rgb| linear_from_srgb(f32::from(rgb[c]) / 255.0)).sum();
            srgb_from_linear(sum / 4.0)
        })
    };
    let rgb: Vec<[f32; 3]> = (0..size.x * size.y).map(pixel).collect();
    Pixels::from_rgb(size, &rgb)
}

/// Root mean square difference of two lists of pictures, in levels of 8 bits.
pub(super) fn difference(a: &[Pixels], b: &[Pixels]) -> f64 {
    let channels = |list: &'_ [Pixels]| -> Vec<u8> {
        list.iter().flat_map(|picture| picture.rgb.iter().flatten().copied()).collect()
    };
    let (a, b) = (channels(a), channels(b));
    let sum: f64 = a.iter().zip(&b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    (sum / a.len().max(1) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(size: UVec2, rgb: [u8; 3]) -> Pixels {
        Pixels { size, rgb: vec![rgb; (size.x * size.y) as usize], alpha: None }
    }

    #[test]
    fn four_pixels_become_one_in_linear_light() {
        let mut picture = filled(UVec2::new(4, 2), [80, 160, 240]);
        assert_eq!(halved(&picture), filled(UVec2::new(2, 1), [80, 160, 240]));
        // Half white, half black: half of the light, code 188 and not 128.
        picture.rgb = [[255; 3], [0; 3]].repeat(4);
        assert_eq!(halved(&picture), filled(UVec2::new(2, 1), [188; 3]));
    }

    #[test]
    fn the_difference_is_in_levels() {
        let (a, b) = (filled(UVec2::new(3, 2), [10, 20, 30]), filled(UVec2::new(3, 2), [13, 23, 27]));
        assert_eq!(difference(&[a.clone(), a.clone()], &[b.clone(), b]), 3.0);
        assert_eq!(difference(std::slice::from_ref(&a), std::slice::from_ref(&a)), 0.0);
    }
}
