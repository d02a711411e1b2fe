//! Short trainings that leave some photos out: do more steps improve views beyond the training photos? The left-out photos are drawn
//! at the end.
//!
//! Two solid scenes train on small photos, the second with three times the steps. If training finds surfaces, the watched photos gain a
//! decibel or more; if it memorises photos, they gain little or lose, and a teacher helps. See docs/benchmarks/few-photos.md.

use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::{Dataset, Photo, View};
use trisplat_scene::report::{Counts, StageDetails, StageReport, counted, to_json};
use trisplat_scene::{Error, Result};
use trisplat_train::budget::part_secs;
use trisplat_train::{TrainOptions, Trained};

/// Longer side of the photos, px, and most triangles of a scene: a step takes about two milliseconds.
const LONGEST_PX: u32 = 96;
const TRIANGLES: u64 = 1500;
/// Fewest pixels of a photo per triangle.
const PIXELS_PER_TRIANGLE: u64 = 4;
/// One photo in this many is watched, at least the second number.
const ONE_IN: usize = 6;
const FEWEST_WATCHED: usize = 3;
/// With fewer photos, none can be spared.
const FEWEST_PHOTOS: usize = 8;
/// Most photos for which photos are watched: with more, memorising starts much later.
const MOST_PHOTOS: usize = 100;
/// Least budget per photo, seconds, and least steps per photo without a budget. In shorter runs the teacher's own training takes time
/// that is worth more without one; the trainings here take an eighth of a second per photo.
const LEAST_SECS_PER_PHOTO: f64 = 2.0;
const LEAST_STEPS_PER_PHOTO: u64 = 115;
/// Least budget, seconds: in shorter runs all steps pay.
const LEAST_SECS: f64 = 40.0;
/// Largest share of the trainings in a run without a budget.
const MOST_SHARE: f64 = 0.1;
/// Steps per photo of the two scenes.
const SOLID_STEPS: [u64; 2] = [25, 75];

/// What short trainings say of photos that they left out.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrialRun {
    /// The photos that were left out.
    pub photos: Vec<String>,
    /// How close two solid trainings came to them.
    pub solid: [WatchedTraining; 2],
}

/// How close a short training came to the photos that it left out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WatchedTraining {
    /// Its steps.
    pub steps: u64,
    /// Mean PSNR, dB.
    pub psnr: f64,
}

trisplat_scene::stage!(TrialRun, "watched");

impl TrialRun {
    /// The scenes of two lengths that `train` makes of small copies of `photos`, some of them marked as held out.
    ///
    /// Errors: photos that cannot be decoded; those of `train`.
    pub(super) fn of(
        photos: &Dataset,
        seed: u64,
        mut train: impl FnMut(&Dataset, &TrainOptions) -> Result<Trained>,
    ) -> Result<Self> {
        let count = photos.train().count();
        let view = |(i, view): (usize, &View)| {
            let camera = view.camera.within(LONGEST_PX);
            let photo = Photo::drawn(view.photo.decode()?.downscaled(camera.size));
            Ok(View { camera, photo, test: is_left_out(i, count), ..view.clone() })
        };
        let views = photos.train().enumerate().map(view).collect::<Result<Vec<_>>>()?;
        let small = Dataset { views, ..photos.clone() };
        let pixels = small.views.iter().map(|view| u64::from(view.camera.size.element_product())).max();
        let max_triangles = (pixels.unwrap_or(0) / PIXELS_PER_TRIANGLE).clamp(1, TRIANGLES);
        let mut scored = |steps_per_photo: u64| {
            let steps = steps_per_photo * count as u64;
            let trained =
                train(&small, &TrainOptions { steps, max_triangles, seed, ..TrainOptions::default() })?;
            let psnr = trained.quality().map_or(f64::NAN, |quality| quality.psnr);
            Ok(WatchedTraining { steps, psnr })
        };
        let [few, many] = SOLID_STEPS;
        let solid = [scored(few)?, scored(many)?];
        Ok(Self { photos: small.test().map(|view| view.name.clone()).collect(), solid })
    }

    /// Gain of more steps, dB; `None` without any finite one.
    pub fn gain(&self) -> Option<f64> {
        let [few, many] = self.solid;
        Some(many.psnr - few.psnr).filter(|gain| gain.is_finite())
    }

    /// A sentence with the results.
    pub fn summary(&self) -> String {
        let ([few, many], photos) = (self.solid, counted(self.photos.len() as u64, "photo"));
        let gain = many.psnr - few.psnr;
        format!(
            "on {photos} left out of training, more steps change a solid scene by {gain:+.2} dB ({} → {} steps)",
            few.steps, many.steps
        )
    }

    /// The trainings as a stage of a report that took `seconds`.
    pub(super) fn stage(&self, seconds: f64) -> StageReport {
        let (before, after) = (Counts::default(), Counts::default());
        let (name, details) = (Self::STAGE.into(), to_json(self));
        StageReport { name, seconds, before, after, skipped: None, details }
    }
}

/// Whether some of `photos` can be spared, and `secs` of a budget suffice for the trainings.
pub(super) fn fits(secs: f64, photos: usize) -> bool {
    let needed = LEAST_SECS.max(LEAST_SECS_PER_PHOTO * photos as f64);
    (FEWEST_PHOTOS..=MOST_PHOTOS).contains(&photos) && secs >= needed
}

/// Whether training photo `i` of `count` is left out: one in six, at least three, spread evenly.
fn is_left_out(i: usize, count: usize) -> bool {
    let watched = (count / ONE_IN).max(FEWEST_WATCHED);
    (0..watched).any(|k| (2 * k + 1) * count / (2 * watched) == i)
}

/// The training photos of `photos`, some of them marked as held out: choices based on these never use the real held-out photos.
///
/// Errors: fewer than eight.
pub fn left_out(photos: &Dataset) -> Result<Dataset> {
    let count = photos.train().count();
    if count < FEWEST_PHOTOS {
        let wants = format!("{FEWEST_PHOTOS} photos or more, as some are left out of training");
        return Err(Error::invalid(
            "dataset",
            format!("{} to train on", counted(count as u64, "photo")),
            wants,
        ));
    }
    let views = photos.train().enumerate();
    let views = views.map(|(i, view)| View { test: is_left_out(i, count), ..view.clone() }).collect();
    Ok(Dataset { views, ..photos.clone() })
}

/// Whether some of `photos` can be spared, and the trainings take little time compared with a run of `options` without a budget.
/// Expected seconds decide instead of a clock, so equal runs decide alike.
pub(super) fn fits_beside(options: &TrainOptions, photos: &Dataset) -> bool {
    let count = photos.train().count();
    let secs = |options: &TrainOptions, photo: UVec2| -> f64 {
        part_secs(options, photo, options.max_triangles).iter().sum()
    };
    let camera = photos.train().map(|view| &view.camera).max_by_key(|camera| camera.size.element_product());
    camera.is_some_and(|camera| {
        let small = camera.within(LONGEST_PX).size;
        let steps = SOLID_STEPS.iter().sum::<u64>() * count as u64;
        let trainings = TrainOptions { steps, max_triangles: TRIANGLES, ..TrainOptions::default() };
        let share = secs(&trainings, small) / secs(options, camera.size);
        let is_long = options.steps >= LEAST_STEPS_PER_PHOTO * count as u64;
        (FEWEST_PHOTOS..=MOST_PHOTOS).contains(&count) && is_long && share <= MOST_SHARE
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_dataset::DatasetOptions;
    use trisplat_synthetic::SyntheticOptions;

    fn gaining(gain: f64) -> TrialRun {
        let photos = ["a", "b", "c"].map(String::from).to_vec();
        let solid = [(40, 20.0), (120, 20.0 + gain)].map(|(steps, psnr)| WatchedTraining { steps, psnr });
        TrialRun { photos, solid }
    }

    #[test]
    fn the_summary_says_what_was_measured() {
        let said =
            "on 3 photos left out of training, more steps change a solid scene by -0.25 dB (40 → 120 steps)";
        assert_eq!(gaining(-0.25).summary(), said);
    }

    #[test]
    fn photos_are_watched_where_some_can_be_spared_and_there_is_time() {
        assert!([(40.0, 8), (60.0, 21), (200.0, 100)].into_iter().all(|(secs, photos)| fits(secs, photos)));
        assert!(
            ![(39.0, 8), (500.0, 7), (73.0, 37), (1e6, 101)]
                .into_iter()
                .any(|(secs, photos)| fits(secs, photos))
        );
    }

    #[test]
    fn photos_are_watched_beside_a_run_that_takes_ten_times_as_long() -> Result<()> {
        let folder = tempfile::tempdir().unwrap();
        let options = SyntheticOptions { views: 24, width: 24, points: 50, ..SyntheticOptions::default() };
        trisplat_synthetic::write(folder.path(), &options)?;
        let photos = Dataset::load(folder.path(), &DatasetOptions::default())?;
        let run = |steps| TrainOptions { steps, max_triangles: 20_000, ..TrainOptions::default() };
        let most = (1..100).find(|thousands| fits_beside(&run(1000 * thousands), &photos));
        assert!(most.is_some_and(|thousands| thousands > 1));
        let few = Dataset { views: photos.views[..7].to_vec(), ..photos };
        assert!(!fits_beside(&run(1_000_000), &few));
        Ok(())
    }
}
