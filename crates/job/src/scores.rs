//! Scores of pictures against photos: PSNR, SSIM and FLIP. PSNR and SSIM are given twice: for the drawing itself,
//! and after the affine map of its colours that fits the photo best.

use super::off_camera::{BesideScores, DepthScores};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::ShrunkSize;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::ColorMap;
use trisplat_scene::math::metric;
use trisplat_train::Quality;

/// What `trisplat eval --report` writes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat eval report")]
pub struct EvalReport {
    /// Program and version.
    pub generator: String,
    /// The soup, mesh or Gaussians, as given.
    pub file: String,
    /// The data set, as given.
    pub dataset: String,
    /// The photos: "test", "train" or "all".
    pub split: String,
    /// Samples per pixel along each axis of solid drawings.
    pub ssaa: u32,
    /// The size that photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photo_size: Option<ShrunkSize>,
    /// The scores at each step from scene to file, in order. A mesh has one, "solid", and Gaussians "splats".
    pub steps: Vec<StepScore>,
    /// Notes for the user, one sentence each.
    pub warnings: Vec<String>,
}

/// The scores of a scene at one step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StepScore {
    /// "soft": the soup as trained. "solid": the scene, or the given mesh, as an engine draws it. "file": the
    /// same, written quantised and compressed, and read back. "splats": Gaussians as their trainers draw them.
    pub name: String,
    /// Number of triangles.
    pub triangles: u64,
    /// Number of Gaussians; absent for triangles.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub splats: Option<u64>,
    /// Size of the file, if one was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Means over the photos, each photo counting once.
    pub mean: Scores,
    /// The mean minus that of the previous step: the loss of this step.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<Scores>,
    /// Depth at the points that photos track; absent without tracks or a solid surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthScores>,
    /// What one sees beside the cameras; absent without a solid surface.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside: Option<BesideScores>,
    /// Photo by photo, in order of name.
    pub images: Vec<ImageScore>,
    /// Seconds spent drawing.
    pub draw_secs: f64,
}

/// Scores of a picture against a photo, both in 8 bits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scores {
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
    /// Structural similarity in the convention of 3DGS.
    pub ssim: f64,
    /// Mean FLIP error; lower is better.
    pub flip: f64,
    /// PSNR after an affine map of the drawing's colours that is fitted to the photo, dB: without the error
    /// of the photo's exposure and white balance.
    #[serde(default)]
    pub psnr_corrected: f64,
    /// SSIM after the same map.
    #[serde(default)]
    pub ssim_corrected: f64,
}

/// One photo's score.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ImageScore {
    /// The photo's name.
    pub name: String,
    /// Width and height, px.
    pub size: [u32; 2],
    /// How close the drawing comes.
    #[serde(flatten)]
    pub score: Scores,
}

/// The drawing of a view at one step, and its scores.
#[derive(Debug)]
pub struct ScoredPicture {
    /// Name of the step.
    pub step: &'static str,
    /// The drawing.
    pub picture: RgbImage,
    /// How close it comes.
    pub score: ImageScore,
}

/// Scores a drawing of a photo.
pub(super) fn measure(step: &'static str, name: &str, photo: &RgbImage, picture: RgbImage) -> ScoredPicture {
    let weights = photo.alpha.as_deref();
    let map = ColorMap::fit(&picture.rgb, &photo.rgb, weights);
    measure_with(step, name, photo, picture, |picture| map.of(&picture.rgb))
}

/// The same after correcting the picture's colours with `corrected`.
fn measure_with(
    step: &'static str,
    name: &str,
    photo: &RgbImage,
    picture: RgbImage,
    corrected: impl FnOnce(&RgbImage) -> Vec<[u8; 3]>,
) -> ScoredPicture {
    let Quality { psnr, ssim } = Quality::of(&picture, photo);
    let corrected = RgbImage { size: picture.size, rgb: corrected(&picture), alpha: None };
    let Quality { psnr: psnr_corrected, ssim: ssim_corrected } = Quality::of(&corrected, photo);
    let flip = metric::flip(photo.size, &photo.rgb, &picture.rgb, photo.alpha.as_deref());
    let score = Scores { psnr, ssim, flip, psnr_corrected, ssim_corrected };
    let (name, size) = (name.to_owned(), photo.size.to_array());
    ScoredPicture { step, picture, score: ImageScore { name, size, score } }
}

/// The same for a photo of an object: over black and over white, as in [`Quality::over_two`]. The picture is
/// that over black. Colours are corrected on the object, not on the background.
pub(super) fn measure_cut(
    step: &'static str,
    name: &str,
    photo: &RgbImage,
    mut draw: impl FnMut([f32; 3]) -> RgbImage,
) -> ScoredPicture {
    let [black, white] = [0, 255].map(|code: u8| draw([f32::from(code) / 255.0; 3]));
    let straight = straight(&black, &white);
    let map = ColorMap::fit(&straight.rgb, &photo.undimmed().rgb, photo.alpha.as_deref());
    let corrected = RgbImage { rgb: map.of(&straight.rgb), ..straight };
    let over = |code: u8, picture: RgbImage| {
        let photo = photo.over_instead_of_black([code; 3]);
        measure_with(step, name, &photo, picture, |_| corrected.clone().over([code; 3]).rgb)
    };
    let (black, white) = (over(0, black), over(255, white));
    let mean = mean([&black.score.score, &white.score.score].into_iter());
    ScoredPicture { score: ImageScore { score: mean, ..black.score }, ..black }
}

/// Colours and opacity, from drawings over black and over white.
fn straight(black: &RgbImage, white: &RgbImage) -> RgbImage {
    let opacity = |(black, white): (&[u8; 3], &[u8; 3])| {
        let through: u32 = (0..3).map(|c| u32::from(white[c].saturating_sub(black[c]))).sum();
        255 - ((through + 1) / 3) as u8
    };
    let alpha = black.rgb.iter().zip(&white.rgb).map(opacity).collect();
    RgbImage { alpha: Some(alpha), ..black.clone() }.undimmed()
}

/// The mean of some scores; zeros without any.
pub(super) fn mean<'a>(scores: impl ExactSizeIterator<Item = &'a Scores> + Clone) -> Scores {
    let count = scores.len().max(1) as f64;
    Scores::each(|of| scores.clone().map(of).sum::<f64>() / count)
}

impl Scores {
    pub(super) fn minus(&self, before: &Self) -> Self {
        Self::each(|of| of(self) - of(before))
    }

    /// Scores whose every number is `number` of its getter.
    fn each(number: impl Fn(fn(&Self) -> f64) -> f64) -> Self {
        Self {
            psnr: number(|s| s.psnr),
            ssim: number(|s| s.ssim),
            flip: number(|s| s.flip),
            psnr_corrected: number(|s| s.psnr_corrected),
            ssim_corrected: number(|s| s.ssim_corrected),
        }
    }
}
