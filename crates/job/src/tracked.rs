//! The poses of a training's photos, before it begins: moved to where the points' tracks see them.

use std::time::Instant;
use trisplat_dataset::tracked_poses::{self, TrackedPoses};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_scene::report::{Counts, StageDetails, StageReport, to_json};
use trisplat_train::PoseUse;

/// Moves the training photos of `dataset` to where their tracks see them, unless `poses` is off. Returns the stage. Tracks that
/// cannot be read are a warning, because a training does without them.
pub(super) fn follow_tracks(dataset: &mut Dataset, how: &DatasetOptions, poses: PoseUse) -> StageReport {
    let clock = Instant::now();
    let skipped = |why: &str| StageReport::skipped(TrackedPoses::STAGE, why.to_owned());
    if poses == PoseUse::Off {
        return skipped("`poses` off");
    }
    let found = match tracked_poses::follow_tracks(dataset, how) {
        Ok(Some(found)) => found,
        Ok(None) => return skipped("the data set has no tracks that could tell"),
        Err(error) => {
            dataset.warnings.push(format!("poses were not compared with tracks: {error}"));
            return skipped("the tracks cannot be read");
        }
    };
    dataset.warnings.extend(found.warning());
    let mut stage = match found.moved {
        0 => skipped("the points' tracks agree with the poses"),
        _ => StageReport { skipped: None, ..skipped("") },
    };
    (stage.before, stage.after) = (Counts::default(), Counts::default());
    (stage.seconds, stage.details) = (clock.elapsed().as_secs_f64(), to_json(&found));
    stage
}
