//! `trisplat bake --harden`: trains a soft scene solid before it is baked.

use super::Global;
use super::progress::Progress;
use super::train_progress::Bar;
use crate::bake::Views;
use crate::bake::teacher::{is_solid, pictures};
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::report::{Counts, StageDetails, StageReport};
use crate::scene::{Loaded, Scene};
use crate::teacher;
use crate::train::{TrainDetails, TrainOptions, TrainPreset, TrainRun};
use std::path::Path;
use std::time::Instant;

/// Triangles that a hardened scene may have, unless the soft one has more.
const LEAST_BUDGET: u64 = 60_000;
/// Largest share of steps that look at soft pictures beside photos.
const MOST_PICTURES: f64 = 0.9;
/// A hardened scene may have this many times as many triangles as the soft one.
const GROWTH: f64 = 1.25;

/// Whether a soft scene is trained to be solid first.
#[derive(Debug, clap::Args)]
pub struct HardenArgs {
    /// Train the scene solid first, on the photos of --dataset or on its own soft pictures: minutes, for a file that
    /// looks like the soft scene.
    #[arg(long, help_heading = "Harden: train a soft scene solid first")]
    pub harden: bool,
    /// Steps of that training
    #[arg(long, value_name = "N", default_value_t = 2000, requires = "harden",
          value_parser = clap::value_parser!(u64).range(1..), help_heading = "Harden: train a soft scene solid first")]
    pub harden_steps: u64,
    /// With --dataset: share of these steps that look at soft pictures from between the photos, 0 to 0.9
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, requires = "harden",
          value_parser = share, help_heading = "Harden: train a soft scene solid first")]
    pub harden_pictures: f64,
}

/// A share that leaves a part of the steps to the photos.
pub(super) fn share(text: &str) -> std::result::Result<f64, String> {
    let share = text.parse().ok().filter(|share| (0.0..=MOST_PICTURES).contains(share));
    share.ok_or_else(|| format!("a number from 0 to {MOST_PICTURES}"))
}

/// A scene that was trained solid.
pub(super) struct Hardened {
    /// The solid scene.
    pub(super) scene: Loaded,
    /// Soft pictures of the scene as it was, when there are no photos.
    pub(super) taught: Option<Views>,
    /// What the training did.
    pub(super) stage: StageReport,
}

impl Hardened {
    /// `scene` as it is, and why nothing was done.
    pub(super) fn needless(scene: Loaded, why: &str) -> Self {
        let triangles = scene.scene.triangle_count() as u64;
        let counts = Counts { triangles, vertices: 3 * triangles };
        let stage = StageReport {
            name: TrainDetails::STAGE.to_owned(),
            seconds: 0.0,
            before: counts,
            after: counts,
            unneeded: Some(why.to_owned()),
            details: Default::default(),
        };
        Self { scene, taught: None, stage }
    }
}

/// Why `scene` need not be hardened, if it is solid.
pub(super) fn needless(scene: &Loaded) -> Option<&'static str> {
    match &scene.scene {
        Scene::Mesh(_) => Some("the input is a mesh: its triangles are solid"),
        Scene::Soup(soup) => is_solid(soup).then_some("the scene is solid already"),
    }
}

/// Trains `soft`, read from `path`, solid: on `photos`, if asked for with soft pictures from between them, or else on soft pictures alone.
///
/// Errors: nothing to look at, photos that cannot be decoded, a run that was stopped.
pub(super) fn harden(
    args: &HardenArgs,
    path: &Path,
    soft: Loaded,
    photos: Option<&Dataset>,
    how: &DatasetOptions,
    options: &TrainOptions,
    global: &Global,
) -> Result<Hardened> {
    let clock = Instant::now();
    let (drawn, taught);
    let dataset = match photos {
        Some(photos) if args.harden_pictures == 0.0 => {
            taught = None;
            photos
        }
        Some(photos) => {
            taught = None;
            drawn = beside(photos, &soft, args.harden_pictures, options, how, global)?;
            &drawn
        }
        None => {
            drawn = draw(path, &soft, options, how, global)?;
            taught = Some(pictures(&soft, drawn.views.iter().map(|view| view.camera).collect()));
            &drawn
        }
    };
    let run = TrainRun::new(dataset, options).with_dataset_options(how);
    let run = TrainRun { from: Some(soft), ..run }.start()?;
    let triangles = run.triangles();
    let mut bar = Bar::new(global, options.steps, 0, None, &[])?;
    let trained = run.finish(&mut bar)?;
    bar.done();
    if trained.stopped {
        let value = format!("stopped after {} of {} steps", trained.steps, options.steps);
        return Err(Error::invalid("harden", value, "all of its steps; nothing was written"));
    }
    let stage = trained.stage(triangles, clock.elapsed().as_secs_f64());
    Ok(Hardened { scene: trained.into(), taught, stage })
}

/// How a scene of so many triangles is hardened; a file may have `max_triangles`.
pub(super) fn options(args: &HardenArgs, triangles: usize, max_triangles: Option<u64>) -> TrainOptions {
    let grown = (triangles as f64 * GROWTH) as u64;
    let most = max_triangles.unwrap_or(LEAST_BUDGET.max(grown)).max(triangles as u64);
    let preset = TrainOptions::from_scene(TrainPreset::Solid);
    TrainOptions { steps: args.harden_steps, max_triangles: most, ..preset }
}

/// `photos`, and beside them as many soft pictures of `scene` as make up `share` of what is trained on, drawn under a bar.
pub(super) fn beside(
    photos: &Dataset,
    scene: &Loaded,
    share: f64,
    options: &TrainOptions,
    how: &DatasetOptions,
    global: &Global,
) -> Result<Dataset> {
    let drawing = options.drawing(how.background.to_f32());
    under_bar(global, |drawn| teacher::beside(photos, scene, &drawing, share, how.photo_bytes(), drawn))
}

/// The soft pictures of `scene` that training takes for photos, drawn under a bar.
pub(super) fn draw(
    path: &Path,
    scene: &Loaded,
    options: &TrainOptions,
    how: &DatasetOptions,
    global: &Global,
) -> Result<Dataset> {
    let drawing = options.drawing(how.background.to_f32());
    under_bar(global, |drawn| teacher::dataset(path, scene, &drawing, how.photo_bytes(), drawn))
}

/// Draws soft pictures; shows how many are drawn.
fn under_bar<T>(global: &Global, draw: impl FnOnce(&mut dyn FnMut(usize, usize)) -> T) -> T {
    let progress = Progress::new(global);
    let drawn = draw(&mut |done, all| progress.note(&format!("drawing soft pictures: {done} of {all}")));
    progress.done();
    drawn
}
