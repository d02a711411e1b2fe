//! Hardening: a soft scene is trained solid before its bake.

use super::event::{Observer, TrainBegins, begin, on_drawn};
use std::path::Path;
use std::time::Instant;
use trisplat_bake::{Views, is_solid, pictures};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_scene::report::{StageDetails, StageReport};
use trisplat_scene::{Error, ImportedScene, Result, Scene};
use trisplat_teacher as teacher;
use trisplat_train::{TrainDetails, TrainOptions, TrainPreset, TrainRun};

/// Most triangles of a hardened scene, unless the soft one has more.
const LEAST_BUDGET: u64 = 60_000;
/// Largest share of steps on soft pictures when there are photos too.
pub const MOST_PICTURES: f64 = 0.9;
/// Most triangles of a hardened scene, as a multiple of the soft scene's.
const GROWTH: f64 = 1.25;

/// Steps of hardening that suit most soft scenes.
pub const HARDEN_STEPS: u64 = 2000;

/// Training options of `steps` for a scene of `triangles`; the file may have `max_triangles`. The training comes down to them early: a scene
/// that is trained with all of its triangles and cut afterwards loses up to 0.9 dB and takes a third more seconds.
pub(super) fn training(steps: u64, triangles: usize, max_triangles: Option<u64>) -> TrainOptions {
    let grown = (triangles as f64 * GROWTH) as u64;
    let max_triangles = max_triangles.unwrap_or(LEAST_BUDGET.max(grown));
    TrainOptions { steps, max_triangles, ..TrainOptions::from_scene(TrainPreset::Solid) }
}

/// A hardened scene.
pub(super) struct Hardened {
    /// The solid scene.
    pub(super) scene: ImportedScene,
    /// Soft pictures of the original scene, when there are no photos.
    pub(super) pictures: Option<Views>,
    /// Report stage of the training.
    pub(super) stage: StageReport,
}

impl Hardened {
    /// `scene` unchanged, and the reason.
    pub(super) fn needless(scene: ImportedScene, why: &str) -> Self {
        let counts = scene.scene.counts();
        let stage = StageReport {
            before: counts,
            after: counts,
            ..StageReport::skipped(TrainDetails::STAGE, why.to_owned())
        };
        Self { scene, pictures: None, stage }
    }
}

/// Why `scene` need not be hardened, if it is solid.
pub(crate) fn needless(scene: &ImportedScene) -> Option<&'static str> {
    match &scene.scene {
        Scene::Mesh(_) => Some("the input is a mesh: its triangles are solid"),
        Scene::Soup(soup) => is_solid(soup).then_some("the scene is solid already"),
    }
}

/// Trains `soft`, read from `path`, solid: on `photos` if there are any, otherwise on its own soft pictures, which
/// are transparent where they show the colour `behind` an object.
///
/// Errors: no cameras to draw from, undecodable photos, a stopped run.
pub(super) fn harden(
    (path, soft): (&Path, ImportedScene),
    behind: Option<[f32; 3]>,
    photos: Option<&Dataset>,
    how: &DatasetOptions,
    options: &TrainOptions,
    observer: Observer<'_>,
) -> Result<Hardened> {
    let clock = Instant::now();
    let drawing = options.drawing(how.background.to_f32());
    let mut own = None;
    let made = match photos {
        Some(_) => None,
        None => {
            let made =
                teacher::dataset(path, &soft, &drawing, behind, how.photo_bytes(), &mut on_drawn(observer))?;
            own = Some(pictures(&soft, behind, made.views.iter().map(|view| view.camera).collect()));
            Some(made)
        }
    };
    let Some(dataset) = made.as_ref().or(photos) else {
        unreachable!("pictures are drawn where there are no photos");
    };
    let (scene, stage) = train(soft, dataset, how, options, clock, observer)?;
    Ok(Hardened { scene, pictures: own, stage })
}

/// Trains `soft` solid on `dataset`; `clock` began with the stage.
///
/// Errors: undecodable photos, a stopped run.
pub(super) fn train(
    soft: ImportedScene,
    dataset: &Dataset,
    how: &DatasetOptions,
    options: &TrainOptions,
    clock: Instant,
    observer: Observer<'_>,
) -> Result<(ImportedScene, StageReport)> {
    let run = TrainRun::new(dataset, options).with_dataset_options(how);
    let run = TrainRun { from: Some(soft), cut_from: true, ..run }.start()?;
    let triangles = run.triangles();
    let begins = TrainBegins { steps: options.steps, ..TrainBegins::default() };
    let trained = run.finish(&mut begin(observer, &begins)?)?;
    if trained.stopped {
        let value = format!("stopped after {} of {} steps", trained.steps, options.steps);
        return Err(Error::invalid("harden", value, "all of its steps; nothing was written"));
    }
    let stage = trained.stage(triangles, clock.elapsed().as_secs_f64());
    Ok((trained.into(), stage))
}
