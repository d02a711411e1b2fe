//! Corrections of the photos' exposures, from the points that they track, before the first step.

use super::options::TrainOptions;
use glam::{UVec2, Vec2};
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use trisplat_dataset::exposure::{
    ExposureDetails, Exposures, Light, Solved, Verdict, compared_points, solve,
};
use trisplat_dataset::{Dataset, View};
use trisplat_scene::{Result, image::RgbImage};

/// Fewer photos do not determine a mean exposure.
const MIN_PHOTOS: usize = 4;

/// The corrections that a run trains with.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ExposureEstimates {
    /// The photos' corrections; empty for none.
    pub exposures: Exposures,
    /// Differences between the photos; `None` where they were not compared.
    pub verdict: Option<Verdict>,
}

/// Estimates how the light of the training photos differs, at the points that they track; `None`
/// where too few photos track any, and of objects before nothing. `photo` reads one.
///
/// # Errors
///
/// Errors of `photo`.
pub fn solve_exposures(
    dataset: &Dataset,
    points: &[Vec<(u32, Vec2)>],
    mut photo: impl FnMut(usize) -> Result<Arc<RgbImage>>,
) -> Result<Option<Solved>> {
    let views: Vec<&View> = dataset.train().collect();
    if views.len() < MIN_PHOTOS || views.iter().any(|view| view.photo.is_cut()) {
        return Ok(None);
    }
    let mut lights = Vec::with_capacity(views.len());
    for (i, points) in points.iter().enumerate() {
        lights.push(Light::of_photo(&photo(i)?, points));
    }
    let sizes: Vec<UVec2> = views.iter().map(|view| view.camera.size).collect();
    Ok(Some(solve(&lights, &sizes)))
}

impl ExposureEstimates {
    /// Estimates the corrections that `options` ask for; photos stay as they are where they are
    /// undecided.
    ///
    /// # Errors
    ///
    /// Errors of `photo`.
    pub(super) fn new(
        dataset: &Dataset,
        options: &TrainOptions,
        photo: impl FnMut(usize) -> Result<Arc<RgbImage>>,
    ) -> Result<Self> {
        let strengths = options.exposure.strengths().unwrap_or_default();
        if strengths.is_none() {
            return Ok(Self::default());
        }
        let Some(points) = compared_points(dataset) else { return Ok(Self::default()) };
        let Some(solved) = solve_exposures(dataset, &points, photo)? else {
            return Ok(Self::default());
        };
        let exposures = solved.corrections(strengths).unwrap_or_default();
        Ok(Self { exposures, verdict: Some(solved.verdict(strengths)) })
    }

    /// Details for the report; `None` where photos were not compared.
    pub(super) fn details(&self) -> Option<ExposureDetails> {
        let details = ExposureDetails { verdict: self.verdict, exposures: self.exposures.clone() };
        self.verdict.is_some().then_some(details)
    }

    /// Corrects a photo for training; returns true beside it if that changed it.
    pub(super) fn correct(&self, index: usize, photo: Arc<RgbImage>) -> (Arc<RgbImage>, bool) {
        match self.exposures.correct(index, &photo) {
            Some(corrected) => (Arc::new(corrected), true),
            None => (photo, false),
        }
    }
}
