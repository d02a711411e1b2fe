//! The photos' exposures: from the points that photos track, before training; without tracks, at some milestones all photos are compared
//! with drawings of the scene. From then on, corrected photos are trained on.

use super::options::TrainOptions;
use glam::{UVec2, Vec2};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use trisplat_dataset::exposure::{
    ExposureDetails, ExposureUse, Exposures, Light, Solved, Verdict, compared_points, compared_size, judge,
    solve,
};
use trisplat_dataset::{Dataset, View};
use trisplat_scene::{Result, image::RgbImage};

/// Shares of a run after which exposures are estimated. They are early, before triangles have absorbed the
/// light of single photos.
const MILESTONES: [f64; 9] = [0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7];
/// After photos agree at this number of milestones, exposures are not estimated again.
const ENOUGH: usize = 3;
/// Fewer photos do not determine a mean exposure.
const LEAST_PHOTOS: usize = 4;

/// A run's estimates of its photos' light.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ExposureEstimates {
    /// Milestones that have passed.
    pub passed: usize,
    /// The photos' corrections; empty for none.
    pub exposures: Exposures,
    /// Of the last milestone.
    pub verdict: Option<Verdict>,
}

impl ExposureEstimates {
    /// What the points say that photos track, before the first step; nothing where too few photos track any. `photo` reads one.
    ///
    /// Errors: those of `photo`.
    pub(super) fn first(
        dataset: &Dataset,
        wanted: ExposureUse,
        mut photo: impl FnMut(usize) -> Result<Arc<RgbImage>>,
    ) -> Result<Self> {
        let views: Vec<&View> = dataset.train().collect();
        let is_cut = |view: &&View| view.photo.is_cut();
        let mut estimates = Self::default();
        if wanted == ExposureUse::Off || views.len() < LEAST_PHOTOS || views.iter().any(is_cut) {
            return Ok(estimates);
        }
        let Some(points) = compared_points(dataset) else { return Ok(estimates) };
        let mut read = |(i, points): (usize, &Vec<(u32, Vec2)>)| {
            let photo = photo(i)?;
            let size = compared_size(photo.size);
            Ok(Light::at_points(&photo.shared_at(size), points))
        };
        let lights = points.iter().enumerate().map(&mut read).collect::<Result<Vec<_>>>()?;
        let sizes: Vec<UVec2> = views.iter().map(|view| view.camera.size).collect();
        estimates.update(solve(&lights, &sizes), wanted);
        estimates.passed = MILESTONES.len();
        Ok(estimates)
    }

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

    /// Takes over what was solved.
    pub(super) fn update(&mut self, solved: Solved, wanted: ExposureUse) {
        let (exposures, verdict) = judge(solved, wanted);
        self.exposures = exposures.unwrap_or_default();
        self.verdict = Some(verdict);
    }

    /// For the report; `None` where photos were not compared.
    pub(super) fn details(&self) -> Option<ExposureDetails> {
        let details = ExposureDetails { verdict: self.verdict, exposures: self.exposures.clone() };
        self.verdict.is_some().then_some(details)
    }

    /// A photo as it is trained on, and the number of its correction, from 1; 0 for none.
    pub(super) fn correct(&self, index: usize, photo: Arc<RgbImage>) -> (Arc<RgbImage>, u32) {
        match self.exposures.correct(index, &photo) {
            Some(corrected) => (Arc::new(corrected), self.passed as u32 + 1),
            None => (photo, 0),
        }
    }
}
