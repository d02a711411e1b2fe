//! The poses of a training's photos, before it begins: moved to where the points' tracks see them.

use crate::dataset::tracked_poses::{self, TrackedPoses};
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::Result;
use crate::report::{Counts, StageDetails, StageReport, to_json};
use crate::train::PoseUse;
use std::time::Instant;

impl StageDetails for TrackedPoses {
    const STAGE: &'static str = "poses";
}

/// Moves the training photos of `dataset` to where their tracks see them, unless `poses` is off. Returns the stage.
///
/// Errors: a model that cannot be read.
pub(super) fn follow_tracks(
    dataset: &mut Dataset,
    how: &DatasetOptions,
    poses: PoseUse,
) -> Result<StageReport> {
    let clock = Instant::now();
    let unneeded = |why: &str| StageReport::unneeded(TrackedPoses::STAGE, why.to_owned());
    if poses == PoseUse::Off {
        return Ok(unneeded("`poses` off"));
    }
    let Some(found) = tracked_poses::follow_tracks(dataset, how)? else {
        return Ok(unneeded("the data set has no tracks that could tell"));
    };
    dataset.warnings.extend(found.warning());
    let mut stage = match found.moved {
        0 => unneeded("the points' tracks agree with the poses"),
        _ => StageReport { unneeded: None, ..unneeded("") },
    };
    (stage.before, stage.after) = (Counts::default(), Counts::default());
    (stage.seconds, stage.details) = (clock.elapsed().as_secs_f64(), to_json(&found));
    Ok(stage)
}
