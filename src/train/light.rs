//! The photos' exposures, found while the scene is trained: now and then all photos are compared with what the scene is drawn like, and from
//! then on the photos are trained on as the others would show them.

use super::options::TrainOptions;
use crate::exposure::{Cells, ExposureUse, Exposures, Verdict, judge, solve};
use crate::image::Pixels;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// Parts of a run after which exposures are found anew. Early, while triangles are too few to have taken on the light of single photos.
const MILESTONES: [f64; 9] = [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7];
/// Photos that agree at this number of milestones are not asked again.
const ENOUGH: usize = 3;
/// Fewer photos say nothing about their mean.
const LEAST_PHOTOS: usize = 4;

/// What a run knows of its photos' light.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Light {
    /// Milestones that have passed.
    pub passed: usize,
    /// What photos are corrected by; empty: they are not.
    pub exposures: Exposures,
    /// Of the last milestone.
    pub verdict: Option<Verdict>,
}

impl Light {
    /// True when exposures are to be found after `step` of a run of `photos`.
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

    /// A photo as it is trained on, and how often those of this run were corrected anew.
    pub(super) fn correct(&self, index: usize, photo: Arc<Pixels>) -> (Arc<Pixels>, u32) {
        match self.exposures.correct(index, &photo) {
            Some(corrected) => (Arc::new(corrected), self.passed as u32),
            None => (photo, 0),
        }
    }
}

/// What a run found of its photos' exposures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ExposureDetails {
    /// How much photos differ.
    #[serde(flatten)]
    pub verdict: Verdict,
    /// What photos were corrected by; none where they agree.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub photos: Vec<PhotoExposure>,
}

/// What a photo was corrected by.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PhotoExposure {
    /// The photo.
    pub name: String,
    /// Logarithm of its gain in linear light, per channel.
    pub gains: [f32; 3],
    /// What its corners lose of the light, as a logarithm.
    pub falloff: f32,
}

impl ExposureDetails {
    /// What `light` knows of the photos with these names; `None` where they were not asked.
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
