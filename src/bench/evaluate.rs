//! How close a scene comes to the photos: draws every view and measures PSNR, SSIM and FLIP.

use super::steps::EvalStep;
use crate::dataset::{Photos, View};
use crate::error::Result;
use crate::image::Pixels;
use crate::math::metric;
use crate::report::generator;
use crate::train::eval::Quality;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Instant;

/// What `trisplat eval --report` writes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat eval report")]
pub struct EvalReport {
    /// Program and version.
    pub generator: String,
    /// The soup or mesh, as given.
    pub file: String,
    /// The data set, as given.
    pub dataset: String,
    /// Which photos: "test", "train" or "all".
    pub split: String,
    /// Samples per pixel along each axis of solid drawings.
    pub ssaa: u32,
    /// The scene at each step of its way into a file, in order. A mesh has one: "solid".
    pub steps: Vec<StepScore>,
    /// What the user should know, one sentence each.
    pub warnings: Vec<String>,
}

/// How close a scene comes at one step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StepScore {
    /// "soft": the soup as trained. "solid": what an engine draws of it, or of the mesh given. "file": the same
    /// written quantised and compressed, and read back.
    pub name: String,
    /// Number of triangles.
    pub triangles: u64,
    /// Size of the file, where one was written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bytes: Option<u64>,
    /// Means over the photos, each photo counting once.
    pub mean: Scores,
    /// The mean minus that of the step before: what this step cost.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<Scores>,
    /// Photo by photo, in order of name.
    pub images: Vec<ImageScore>,
    /// Seconds spent drawing.
    pub draw_secs: f64,
}

/// How close a picture comes to a photo, both in 8 bits.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Scores {
    /// Peak signal-to-noise ratio, dB.
    pub psnr: f64,
    /// Structural similarity in the convention of 3DGS.
    pub ssim: f64,
    /// Mean FLIP error; lower is better.
    pub flip: f64,
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
    pub picture: Pixels,
    /// FLIP error of every pixel. `[H * W]`
    pub flip: Vec<f32>,
    /// How close it comes.
    pub score: ImageScore,
}

/// Draws and measures `views` at every step. Calls `on_view` with each view, its photo and its drawings as soon as
/// they are there. Returns the scores, step by step.
pub fn evaluate(
    steps: &mut [EvalStep],
    views: &[&View],
    photo_bytes: u64,
    mut on_view: impl FnMut(&View, &Pixels, &[ScoredPicture]) -> Result<()>,
) -> Result<Vec<StepScore>> {
    for step in &*steps {
        views.iter().try_for_each(|view| step.renderer.validate(view.camera.size))?;
    }
    let mut photos = Photos::new(views.iter().map(|v| v.photo.clone()).collect(), photo_bytes);
    photos.prefetch(0..views.len());
    let mut images: Vec<Vec<ImageScore>> = steps.iter().map(|_| Vec::new()).collect();
    let mut secs = vec![0.0; steps.len()];
    for (i, view) in views.iter().enumerate() {
        let photo = photos.take(i)?;
        let mut drawn = Vec::with_capacity(steps.len());
        for (step, secs) in steps.iter_mut().zip(&mut secs) {
            let clock = Instant::now();
            let picture = step.renderer.color(&view.camera);
            *secs += clock.elapsed().as_secs_f64();
            drawn.push(measure(step.name, &view.name, &photo, picture));
        }
        on_view(view, &photo, &drawn)?;
        images.iter_mut().zip(drawn).for_each(|(images, drawn)| images.push(drawn.score));
    }
    let mut scores: Vec<StepScore> = Vec::with_capacity(steps.len());
    for ((step, images), draw_secs) in steps.iter().zip(images).zip(secs) {
        let mean = mean(&images);
        let change = scores.last().map(|before| mean.minus(&before.mean));
        let (name, triangles, bytes) = (step.name.to_owned(), step.triangles, step.bytes);
        scores.push(StepScore { name, triangles, bytes, mean, change, images, draw_secs });
    }
    Ok(scores)
}

fn measure(step: &'static str, name: &str, photo: &Pixels, picture: Pixels) -> ScoredPicture {
    let Quality { psnr, ssim } = Quality::of(&picture, photo);
    let flip = metric::flip_map(photo.size, &photo.rgb, &picture.rgb);
    let score = Scores { psnr, ssim, flip: metric::mean_error(&flip, photo.alpha.as_deref()) };
    let score = ImageScore { name: name.to_owned(), size: photo.size.to_array(), score };
    ScoredPicture { step, picture, flip, score }
}

/// The mean of some scores; zeros of none.
pub fn mean(scores: &[ImageScore]) -> Scores {
    let count = scores.len().max(1) as f64;
    let mean = |of: fn(&Scores) -> f64| scores.iter().map(|s| of(&s.score)).sum::<f64>() / count;
    Scores { psnr: mean(|s| s.psnr), ssim: mean(|s| s.ssim), flip: mean(|s| s.flip) }
}

impl Scores {
    fn minus(&self, before: &Self) -> Self {
        Self { psnr: self.psnr - before.psnr, ssim: self.ssim - before.ssim, flip: self.flip - before.flip }
    }
}

impl EvalReport {
    /// A report of scores.
    pub fn new(file: &Path, dataset: &Path, split: &str, ssaa: u32, steps: Vec<StepScore>) -> Self {
        Self {
            generator: generator(),
            file: file.display().to_string(),
            dataset: dataset.display().to_string(),
            split: split.to_owned(),
            ssaa,
            steps,
            warnings: Vec::new(),
        }
    }
}
