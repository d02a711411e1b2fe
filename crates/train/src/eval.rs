//! Scores of a scene on the held-out photos, during training.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::{Photos, ShrunkSize, View};
use trisplat_raster::soft::{SoftOptions, SoftRasterizer, SoupRef, Window};
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::{ColorMap, linear_from_srgb};
use trisplat_scene::math::metric;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{FaceSh, Result, SceneNormalization, Soup, rgb_from_sh0};

/// Samples per pixel along each axis wherever solid drawings are compared with photos.
pub const SOLID_SAMPLES: u32 = 4;

/// Scores of a picture against a photo, both in 8 bits.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Quality {
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
    /// Structural similarity in the convention of 3DGS.
    pub ssim: f64,
}

impl Quality {
    /// Compares `picture` with `photo`, of the same size; the photo's alpha is the weight of each
    /// pixel.
    pub fn of(picture: &RgbImage, photo: &RgbImage) -> Self {
        let weights = photo.alpha.as_deref();
        Self {
            psnr: metric::psnr(&picture.rgb, &photo.rgb, weights),
            ssim: metric::ssim(picture.size, &picture.rgb, &photo.rgb, weights),
        }
    }

    /// The mean score over black and over white, so that neither colour passes for background.
    /// `draw` draws over a background, sRGB-encoded; the photo holds an object's opacity and its
    /// colours over black.
    pub fn over_two(
        photo: &RgbImage,
        mut draw: impl FnMut([f32; 3]) -> Result<RgbImage>,
    ) -> Result<Self> {
        let mut of = |code: u8| {
            let picture = draw([f32::from(code) / 255.0; 3])?;
            Ok(Self::of(&picture, &photo.recomposited([code; 3])))
        };
        let [black, white] = [of(0)?, of(255)?];
        Ok(Self { psnr: (black.psnr + white.psnr) / 2.0, ssim: (black.ssim + white.ssim) / 2.0 })
    }

    /// Means over photos; `None` without photos.
    pub fn mean(scores: &[PhotoScore]) -> Option<Self> {
        let n = scores.len() as f64;
        let sum = scores.iter().fold((0.0, 0.0), |sum, s| (sum.0 + s.psnr, sum.1 + s.ssim));
        (!scores.is_empty()).then(|| Self { psnr: sum.0 / n, ssim: sum.1 / n })
    }
}

/// Scores of a picture against a held-out photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PhotoScore {
    /// The photo.
    pub name: String,
    /// PSNR of the 8-bit picture, dB.
    pub psnr: f64,
    /// SSIM of the 8-bit picture, 3DGS's convention.
    pub ssim: f64,
    /// PSNR after one affine map of the picture's colours, dB; absent of an object before nothing.
    /// A scene of corrected photos cannot know the exposure of this one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_corrected: Option<f64>,
}

impl PhotoScore {
    fn of(name: &str, quality: Quality, psnr_corrected: Option<f64>) -> Self {
        Self { name: name.to_owned(), psnr: quality.psnr, ssim: quality.ssim, psnr_corrected }
    }

    /// The mean PSNR after a map of colours for each photo, dB; `None` of none, or where one has no
    /// such figure.
    pub fn mean_corrected(scores: &[Self]) -> Option<f64> {
        let sum = scores.iter().map(|score| score.psnr_corrected).sum::<Option<f64>>()?;
        (!scores.is_empty()).then(|| sum / scores.len() as f64)
    }
}

/// Draws held-out photos one by one and compares. Photos are decoded once; those that do not fit
/// the memory for them are in a temporary file.
#[derive(Debug)]
pub(crate) struct Evaluator {
    pub(crate) views: Vec<EvalView>,
    photos: Photos,
    /// The size that the photos were shrunk to; `None` where they were not.
    pub(crate) shrunk: Option<ShrunkSize>,
    soft: SoftRasterizer,
    solid: SolidRasterizer,
}

#[derive(Debug)]
pub(crate) struct EvalView {
    name: String,
    camera: Camera,
    cut: bool,
}

impl Evaluator {
    /// Decodes the photos of `views`, so that broken ones are found now; `photo_bytes` is the
    /// memory for them.
    pub(crate) fn new(views: &[&View], photo_bytes: u64) -> Result<Self> {
        let mut photos = Photos::new(views.iter().map(|v| v.photo.clone()).collect(), photo_bytes);
        photos.prefetch(0..photos.len());
        (0..photos.len()).try_for_each(|i| photos.take(i).map(drop))?;
        let view =
            |v: &&View| EvalView { name: v.name.clone(), camera: v.camera, cut: v.photo.is_cut() };
        let shrunk = ShrunkSize::of(views.iter().copied());
        let views = views.iter().map(view).collect();
        Ok(Self {
            views,
            photos,
            shrunk,
            soft: SoftRasterizer::new(),
            solid: SolidRasterizer::new(),
        })
    }

    /// Draws a soup of the world for the first photo; `None` when none is held out.
    pub(crate) fn first_picture(
        &mut self,
        soup: &Soup,
        space: &SceneNormalization,
        options: &SoftOptions,
    ) -> Option<RgbImage> {
        let camera = space.camera_to_training(&self.views.first()?.camera);
        let scene = EvalScene::new(soup, space, options);
        Some(scene.draw(&camera, options, &mut self.soft, &mut self.solid))
    }

    /// Draws a soup of the world for the first `most` photos and compares. Fails when a photo
    /// cannot be decoded.
    pub(crate) fn scores(
        &mut self,
        most: usize,
        soup: &Soup,
        space: &SceneNormalization,
        options: &SoftOptions,
    ) -> Result<Vec<PhotoScore>> {
        let scene = EvalScene::new(soup, space, options);
        let mut soft = std::mem::take(&mut self.soft);
        let mut solid = std::mem::take(&mut self.solid);
        let scores = self.scores_of(most, options, |camera, options| {
            let camera = space.camera_to_training(camera);
            Ok(scene.draw(&camera, options, &mut soft, &mut solid))
        });
        self.soft = soft;
        self.solid = solid;
        scores
    }

    /// Compares the first `most` photos with the picture of `draw` for its camera, in the world,
    /// drawn with `options`; objects get other backgrounds. Fails when it does, or when a photo
    /// cannot be decoded.
    pub(crate) fn scores_of(
        &mut self,
        most: usize,
        options: &SoftOptions,
        mut draw: impl FnMut(&Camera, &SoftOptions) -> Result<RgbImage>,
    ) -> Result<Vec<PhotoScore>> {
        self.photos.prefetch(0..self.views.len().min(most));
        let mut scores = Vec::with_capacity(self.views.len());
        for (i, EvalView { name, camera, cut }) in self.views.iter().enumerate().take(most) {
            let photo = self.photos.take(i)?;
            scores.push(if !(*cut && photo.alpha.is_some()) {
                let picture = draw(camera, options)?;
                let weights = photo.alpha.as_deref();
                let map = ColorMap::fit(&picture.rgb, &photo.rgb, weights);
                let corrected = metric::psnr(&map.of(&picture.rgb), &photo.rgb, weights);
                PhotoScore::of(name, Quality::of(&picture, &photo), Some(corrected))
            } else {
                let draw = |background| draw(camera, &SoftOptions { background, ..*options });
                PhotoScore::of(name, Quality::over_two(&photo, draw)?, None)
            });
        }
        Ok(scores)
    }
}

/// A scene to be compared, in training space, where f32 is precise.
#[derive(Debug)]
pub enum EvalScene {
    /// Drawn by the soft rasteriser.
    Soft(Soup),
    /// Drawn as an engine draws it.
    Solid(Mesh, SolidRasterOptions),
}

impl EvalScene {
    /// The scene of `soup` in the training space of `space`: solid if `options` draw with samples,
    /// else soft.
    pub fn new(soup: &Soup, space: &SceneNormalization, options: &SoftOptions) -> Self {
        let mut soup = soup.clone();
        space.soup_to_training(&mut soup);
        let Some(samples) = solid_samples(options) else { return Self::Soft(soup) };
        let sh = FaceSh::of_soup(&soup).ok();
        soup.truncate_sh(0);
        let brightest = if sh.is_some() { 1.0 } else { f32::INFINITY };
        let light = |sh: &[f32; 3]| sh.map(|c| linear_from_srgb(rgb_from_sh0(c)).min(brightest));
        let mesh = Mesh {
            positions: soup.vertices.into_flattened(),
            colors: Colors::Face(soup.sh.iter().map(light).collect()),
            sh,
            ..Mesh::default()
        };
        Self::Solid(
            mesh,
            SolidRasterOptions { background: options.background, samples, near: options.near },
        )
    }

    /// The view of `camera`, in training space; solid scenes as an engine draws them.
    pub fn draw(
        &self,
        camera: &Camera,
        options: &SoftOptions,
        soft: &mut SoftRasterizer,
        solid: &mut SolidRasterizer,
    ) -> RgbImage {
        match self {
            Self::Soft(soup) => soft.render(&SoupRef::from(soup), camera, options).to_pixels(),
            Self::Solid(mesh, drawing) => {
                let drawing = SolidRasterOptions { background: options.background, ..*drawing };
                solid.render(mesh, camera, &drawing)
            }
        }
    }
}

/// Samples per pixel along each axis for comparing a scene of `options`, if it is drawn solid.
pub(super) fn solid_samples(options: &SoftOptions) -> Option<u32> {
    matches!(options.window, Window::Coverage { .. }).then_some(SOLID_SAMPLES)
}

/// The state of a run after some step: one point of its curve.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrainSample {
    /// Steps made.
    pub step: u64,
    /// Triangles.
    pub triangles: u64,
    /// Loss, averaged over the last steps.
    pub loss: f64,
    /// PSNR on the training photos as drawn, averaged over the last steps, dB.
    pub psnr: f64,
    /// PSNR on the held-out photos, dB; only if measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_psnr: Option<f64>,
    /// The size that these photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_size: Option<ShrunkSize>,
    /// Width of the last photo, px.
    pub width_px: u32,
    /// CPU seconds of the process, evaluation excluded.
    pub cpu_secs: f64,
    /// Wall-clock seconds since this process began training.
    pub wall_secs: f64,
    /// Gradients dropped so far because they were not finite.
    pub dropped: u64,
}
