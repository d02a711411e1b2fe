//! `trisplat bake --harden`: trains a soft scene solid before it is baked.

use super::Global;
use super::progress::Progress;
use std::path::Path;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_job::MOST_PICTURES;
use trisplat_scene::{ImportedScene, Result};
use trisplat_teacher as teacher;
use trisplat_train::TrainOptions;

/// Whether a soft scene is trained solid first.
#[derive(Debug, clap::Args)]
pub struct HardenArgs {
    /// Train a soft scene solid first: minutes, for a file that looks like the soft scene.
    ///
    /// It is trained on the photos of --dataset, or on its own soft pictures, in 2000 steps or N. Gaussian
    /// splats are always trained solid: with it in four times as many steps, on more and larger pictures.
    #[arg(long, value_name = "STEPS", num_args = 0..=1, require_equals = true, default_missing_value = "2000",
          value_parser = clap::value_parser!(u64).range(1..=1_000_000_000))]
    pub harden: Option<u64>,
}

/// A share below 1, which leaves some steps to the photos.
pub(super) fn share(text: &str) -> std::result::Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.0..=MOST_PICTURES).contains(share));
    share.ok_or_else(|| format!("a number from 0 to {MOST_PICTURES}"))
}

/// The soft pictures of `scene` that replace photos in training, drawn under a bar.
pub(super) fn draw(
    path: &Path,
    scene: &ImportedScene,
    options: &TrainOptions,
    behind: Option<[f32; 3]>,
    how: &DatasetOptions,
    global: &Global,
) -> Result<Dataset> {
    let drawing = options.drawing(how.background.to_f32());
    under_bar(global, |drawn| teacher::dataset(path, scene, &drawing, behind, how.photo_bytes(), drawn))
}

/// Draws soft pictures, and shows the progress.
fn under_bar<T>(global: &Global, draw: impl FnOnce(&mut dyn FnMut(usize, usize)) -> T) -> T {
    let progress = Progress::new(global);
    let drawn = draw(&mut |done, all| progress.note(&format!("drawing soft pictures: {done} of {all}")));
    progress.done();
    drawn
}
