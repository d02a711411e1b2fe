//! The photos' exposures, estimated during training. At some milestones all photos are compared with drawings
//! of the scene; from then on, corrected photos are trained on.

use super::options::TrainOptions;
use crate::exposure::{Cells, ExposureUse, Exposures, Verdict, judge, solve};
use crate::image::Pixels;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Shares of a run after which exposures are estimated. They are early, before triangles have absorbed the
/// light of single photos.
const MILESTONES: [f64; 9] = [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7];
/// After photos agree at this number of milestones, exposures are not estimated again.
const ENOUGH: usize = 3;
/// Fewer photos do not determine a mean exposure.
const LEAST_PHOTOS: usize = 4;

/// A run's estimates of its photos' light.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Milestones that have passed.
    pub passed: usize,
    /// The photos' corrections; empty for none.
    pub exposures: Exposures,
    /// Of the last milestone.
    pub verdict: Option<Verdict>,
}

impl Light {
    /// True when exposures must be estimated after `step` of a run of `photos`.
    pub(super) fn is_due(&mut self, step: u64, options: &TrainOptions, photos: usize) -> bool {
        let at = step as f64 / options.steps.max(1) as f64;
        let settled = self.exposures.gains.is_empty() && self.passed >= ENOUGH;
        if options.exposure == ExposureUse::Off || photos < LEAST_PHOTOS || settled || step < photos as u64 {
            return false;
        }
        let passed = MILESTONES.iter().filter(|milestone| at >= **milestone).count();
        let due = passed > self.passed;
        self.passed = self.passed.max(passed);
        due
    }

    /// Takes over what `photos` say.
    pub(super) fn update(&mut self, photos: &[Cells], wanted: ExposureUse) {
        let (exposures, verdict) = judge(solve(photos), wanted);
        self.exposures = exposures.unwrap_or_default();
        self.verdict = Some(verdict);
    }

    /// A photo as it is trained on, and the number of corrections in this run so far.
    pub(super) fn correct(&self, index: usize, photo: Arc<Pixels>) -> (Arc<Pixels>, u32) {
        match self.exposures.correct(index, &photo) {
            Some(corrected) => (Arc::new(corrected), self.passed as u32),
            None => (photo, 0),
        }
    }
}

/// A run's estimate of its photos' exposures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExposureDetails {
    /// How much photos differ.
    #[serde(flatten)]
    pub verdict: Verdict,
    /// The photos' corrections; none where they agree.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub photos: Vec<PhotoExposure>,
}

/// The correction of a photo.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PhotoExposure {
    /// The photo.
    pub name: String,
    /// Logarithm of its gain in linear light, per channel.
    pub gains: [f32; 3],
    /// The loss of light in its corners, as a logarithm.
    pub falloff: f32,
}

impl ExposureDetails {
    /// The estimates in `light` for photos with these names; `None` if there are none.
    pub(super) fn new<'a>(light: &Light, names: impl Iterator<Item = &'a str>) -> Option<Self> {
        let Exposures { gains, falloff } = &light.exposures;
        let photo = |((name, gains), falloff): ((&str, &[f32; 3]), &f32)| PhotoExposure {
            name: name.to_owned(),
            gains: *gains,
            falloff: *falloff,
        };
        let photos = names.zip(gains).zip(falloff).map(photo).collect();
        light.verdict.map(|verdict| Self { verdict, photos })
    }
}
