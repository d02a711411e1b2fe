//! The speed of the machine, which a budget is planned with.

use super::budget::{Spending, step_secs};
use super::inputs::TrainInputs;
use super::options::{REFERENCE_STEPS, TrainOptions, WarmupOptions};
use super::pyramid::{MIN_PX, size_at};
use trisplat_dataset::{Dataset, Photo, View};
use trisplat_scene::{Error, ImportedScene, Result};

/// Number of photos to measure by.
const MEASURED_PHOTOS: usize = 3;
/// Seconds after which the measurement ends: some clocks advance only every 16 ms.
const MEASURED_SECS: f64 = 0.05;
/// Steps after which the measurement ends.
const MEASURED_STEPS: u64 = 200;

/// Measures the seconds on the budget's clock per second of `step_secs`, by soft steps on photos of
/// half size; the scene is dropped.
///
/// # Errors
///
/// As [`TrainInputs::start`]; photos that cannot be decoded; a system without CPU time.
pub fn measure_speed(
    dataset: &Dataset,
    from: Option<&ImportedScene>,
    options: &TrainOptions,
    background: [f32; 3],
    spending: &Spending,
) -> Result<f64> {
    let stride = (dataset.train().count() / MEASURED_PHOTOS).max(1);
    let measured = dataset.train().step_by(stride).take(MEASURED_PHOTOS);
    let decoded =
        |view: &View| Ok(View { photo: Photo::drawn(view.photo.decode()?), ..view.clone() });
    let dataset =
        Dataset { views: measured.map(decoded).collect::<Result<_>>()?, ..dataset.clone() };
    // Positions of this schedule are steps, so the first ones contain nothing else.
    let steps = REFERENCE_STEPS as u64;
    let warmup = WarmupOptions { quarter_until: 0.0, half_until: REFERENCE_STEPS };
    let options = TrainOptions { steps, milestones: [0; 4], warmup, ..options.clone() };
    let mut inputs =
        TrainInputs { background, photo_bytes: u64::MAX, ..TrainInputs::new(&dataset, &options) };
    inputs.from = from.cloned();
    let mut training = inputs.start()?;
    // The first step allocates.
    training.step()?;
    let before = spending.seconds();
    let mut expected = 0.0;
    let mut taken = 0.0;
    while taken < MEASURED_SECS && training.steps() < MEASURED_STEPS {
        for view in &dataset.views {
            training.step()?;
            let pixels = size_at(view.photo.size, 1, MIN_PX).as_dvec2().element_product();
            expected += step_secs(false, training.triangles() as f64, pixels);
        }
        taken = spending.seconds() - before;
    }
    let wants = "a system that reports CPU time, or `budget_wall`";
    if taken > 0.0 {
        Ok(taken / expected)
    } else {
        Err(Error::invalid("budget", "in CPU time", wants))
    }
}
