//! Decides how far photos are corrected in exposure, by photos that short trainings leave out.
//!
//! Tracked points predict every photo's gain, white balance and falloff. Solid scenes are trained
//! on uncorrected small photos, a quarter of them left out, and drawn for the left-out cameras.
//! The share of the predictions that these photos confirm is corrected: [`ExposureEvidence`]. See
//! docs/benchmarks/exposure.md.

use super::event::{Observer, TrainBegins, TrainPart, begin, stopped_error};
use glam::UVec2;
use std::sync::Arc;
use trisplat_dataset::exposure::{
    ExposureEvidence, ExposureUse, LeftOutPhoto, Light, Solved, Strengths, compared_points,
};
use trisplat_dataset::{Dataset, DatasetOptions, Photo, View};
use trisplat_raster::soft::{SoftOptions, SoftRasterizer, Window};
use trisplat_raster::solid::SolidRasterizer;
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Result, SceneNormalization};
use trisplat_train::budget::part_secs;
use trisplat_train::{EvalScene, TrainInputs, TrainOptions, Trained, solve_exposures};

/// Longer side of the photos, px: a step takes about two milliseconds.
const LONGER_PX: u32 = 96;
/// Maximum number of triangles of a scene.
const MAX_TRIANGLES: u64 = 1500;
/// Minimum pixels of a photo per triangle.
const MIN_PIXELS_PER_TRIANGLE: u64 = 4;
/// Steps per photo.
const STEPS_PER_PHOTO: u64 = 25;
/// One photo in this many is left out of a training; each training leaves out others.
const LEFT_OUT_EVERY: usize = 4;
/// Number of left-out photos that decide, if there are as many. One fit through fewer is easily led
/// by a single photo.
const DECIDING_PHOTOS: usize = 12;
/// With fewer photos, none can be spared.
const MIN_PHOTOS: usize = 8;
/// Maximum share of the run's time.
const MAX_SHARE: f64 = 0.1;
/// Smaller differences of light are less than a code of an 8-bit photo.
const MIN_SPREAD: f32 = 0.02;

/// A decision, or why the photos are taken as they are.
pub(super) enum ExposureDecision {
    /// By left-out photos.
    Judged(ExposureEvidence),
    /// Not judged.
    AsTaken(&'static str),
}

/// Decides how far the training photos of `dataset` are corrected in a run with `options` that has
/// `budget_secs`, if it has a budget.
///
/// # Errors
///
/// Photos that cannot be decoded; a stopped training.
pub(super) fn decide(
    dataset: &Dataset,
    options: &TrainOptions,
    budget_secs: Option<f64>,
    how: &DatasetOptions,
    observer: Observer<'_>,
) -> Result<ExposureDecision> {
    use ExposureDecision::{AsTaken, Judged};
    let count = dataset.train().count();
    if dataset.train().any(|view| view.photo.is_cut()) {
        return Ok(AsTaken("photos of objects before nothing are taken as they are"));
    }
    let Some(points) = compared_points(dataset) else {
        return Ok(AsTaken("photos track no points, so their exposures are unknown"));
    };
    if count < MIN_PHOTOS {
        return Ok(AsTaken(
            "there are too few photos to leave some out (`exposure` on corrects them)",
        ));
    }
    if !has_time(dataset, options, budget_secs) {
        let why = "there is no time to leave photos out of a short training (`exposure` on corrects them)";
        return Ok(AsTaken(why));
    }
    let mut small = Vec::with_capacity(count);
    let views: Vec<&View> = dataset.train().collect();
    let solved = solve_exposures(dataset, &points, |i| {
        let photo = Arc::new(views[i].photo.decode()?);
        let camera = views[i].camera.fit_within(LONGER_PX);
        small.push(View {
            camera,
            photo: Photo::drawn(photo.downscaled(camera.size)),
            ..views[i].clone()
        });
        Ok(photo)
    })?;
    let Some(solved) = solved else { return Ok(AsTaken("there are too few photos to compare")) };
    let spread = solved.verdict(Strengths::NONE);
    if spread.exposure.max(spread.balance).max(spread.corners) < MIN_SPREAD {
        return Ok(AsTaken("photos agree"));
    }
    let small = Dataset { views: small, ..dataset.clone() };
    let mut left_out = Vec::new();
    for first in first_left_out(count) {
        let fold = small.leaving_out(|i| i % LEFT_OUT_EVERY == first);
        let trained = train(&fold, trial_options(&small, options.seed), how, observer)?;
        compare(&fold, &trained, &solved, &mut left_out)?;
    }
    Ok(Judged(ExposureEvidence::of(&left_out)))
}

/// The first left-out photo of each training.
fn first_left_out(photos: usize) -> impl Iterator<Item = usize> {
    let of_each = (photos / LEFT_OUT_EVERY).max(1);
    let trainings = DECIDING_PHOTOS.div_ceil(of_each).min(LEFT_OUT_EVERY);
    [1, 3, 0, 2].into_iter().take(trainings)
}

/// Options of a training on the photos of `small` but those left out.
fn trial_options(small: &Dataset, seed: u64) -> TrainOptions {
    let sizes = small.views.iter().map(|view| u64::from(view.camera.size.element_product()));
    let pixels = sizes.max().unwrap_or(0);
    let trained_on = small.views.len() - small.views.len() / LEFT_OUT_EVERY;
    TrainOptions {
        steps: STEPS_PER_PHOTO * trained_on as u64,
        max_triangles: (pixels / MIN_PIXELS_PER_TRIANGLE).clamp(1, MAX_TRIANGLES),
        seed,
        exposure: ExposureUse::Off,
        ..TrainOptions::default()
    }
}

/// True if the trainings take little of the time of the run. Expected seconds decide instead of a
/// clock, so equal runs decide alike.
fn has_time(dataset: &Dataset, options: &TrainOptions, budget_secs: Option<f64>) -> bool {
    let largest =
        dataset.train().map(|view| view.camera).max_by_key(|camera| camera.size.element_product());
    let Some(camera) = largest else { return false };
    let secs = |options: &TrainOptions, photo: UVec2| -> f64 {
        part_secs(options, photo, options.max_triangles).iter().sum()
    };
    let count = dataset.train().count();
    let trained_on = (count - count / LEFT_OUT_EVERY) as u64;
    let steps = STEPS_PER_PHOTO * trained_on * first_left_out(count).count() as u64;
    let trainings = TrainOptions { steps, max_triangles: MAX_TRIANGLES, ..TrainOptions::default() };
    let run_secs = budget_secs.unwrap_or_else(|| secs(options, camera.size));
    secs(&trainings, camera.fit_within(LONGER_PX).size) <= MAX_SHARE * run_secs
}

/// A short training on a CPU: a graphics card gains nothing on small photos.
fn train(
    fold: &Dataset,
    options: TrainOptions,
    how: &DatasetOptions,
    observer: Observer<'_>,
) -> Result<Trained> {
    let begins =
        TrainBegins { part: TrainPart::Trial, steps: options.steps, ..TrainBegins::default() };
    let run = TrainInputs::new(fold, &options).with_dataset_options(how);
    let trained = run.run(&mut begin(observer, &begins)?)?;
    if trained.stopped {
        Err(stopped_error("a short training that leaves some photos out", &trained))
    } else {
        Ok(trained)
    }
}

/// Adds the left-out photos of `fold` beside drawings of the scene that was trained without them.
fn compare(
    fold: &Dataset,
    trained: &Trained,
    solved: &Solved,
    left_out: &mut Vec<LeftOutPhoto>,
) -> Result<()> {
    let cameras: Vec<_> = fold.views.iter().map(|view| view.camera).collect();
    let positions: Vec<_> = fold.points.iter().map(|point| point.position).collect();
    let space = SceneNormalization::new(&cameras, &positions);
    let drawing =
        SoftOptions { window: Window::Coverage { width_px: 1.0 }, ..SoftOptions::default() };
    let scene = EvalScene::new(&trained.soup, &space, &drawing);
    let mut soft = SoftRasterizer::new();
    let mut solid = SolidRasterizer::new();
    for (i, view) in fold.views.iter().enumerate().filter(|(_, view)| view.test) {
        // Unknown exposures predict nothing.
        if solved.errors[i][1].is_infinite() {
            continue;
        }
        let photo: RgbImage = view.photo.decode()?;
        let drawn =
            scene.draw(&space.camera_to_training(&view.camera), &drawing, &mut soft, &mut solid);
        left_out.push(LeftOutPhoto {
            cells: Light::beside_drawing(&photo, &drawn),
            gains: solved.exposures.gains[i],
            beside_others: solved.beside_others[i],
            falloff: solved.exposures.falloff[i].max(0.0),
            falloff_beside_others: solved.falloff_beside_others,
        });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dozen_left_out_photos_decide_where_there_are_as_many() {
        let trainings = [8, 12, 20, 24, 48, 300].map(|photos| first_left_out(photos).count());
        assert_eq!(trainings, [4, 4, 3, 2, 1, 1]);
    }

    #[test]
    fn a_run_has_time_for_trainings_of_a_tenth_of_it() -> Result<()> {
        let folder = tempfile::tempdir().unwrap();
        let options = trisplat_synthetic::SyntheticOptions {
            views: 24,
            width: 24,
            points: 50,
            ..Default::default()
        };
        trisplat_synthetic::write(folder.path(), &options)?;
        let photos = Dataset::load(folder.path(), &DatasetOptions::default())?;
        let run = |steps| TrainOptions { steps, max_triangles: 20_000, ..TrainOptions::default() };
        assert!(!has_time(&photos, &run(100), None) && has_time(&photos, &run(100_000), None));
        assert!(
            !has_time(&photos, &run(100_000), Some(1.0))
                && has_time(&photos, &run(100), Some(1000.0))
        );
        Ok(())
    }
}
