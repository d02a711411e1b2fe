//! The photos' exposures, estimated during training. At some milestones all photos are compared with drawings
//! of the scene; from then on, corrected photos are trained on.

use super::options::TrainOptions;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::sync::Arc;
use trisplat_dataset::View;
use trisplat_dataset::exposure::{Cells, ExposureUse, Exposures, Solved, Verdict, judge, solve};
use trisplat_scene::image::RgbImage;

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
    /// A first guess by the EXIF data of the photos, if all of them say how much light they caught. Drawn pictures
    /// need none.
    pub(super) fn first(views: &[&View], wanted: ExposureUse) -> Self {
        let is_cut = |view: &&View| view.photo.is_cut();
        if wanted == ExposureUse::Off || views.len() < LEAST_PHOTOS || views.iter().any(is_cut) {
            return Self::default();
        }
        let stops = views.iter().map(|view| match view.photo.is_drawn() {
            true => Some(None),
            false => view.photo.exposure_stops().map(Some),
        });
        // The first photo without such data ends the reading.
        stops.collect::<Option<Vec<_>>>().map_or_else(Self::default, |stops| Self::guessed(&stops, wanted))
    }

    /// A first guess by the stops of each photo; `None` for a drawn picture.
    fn guessed(stops: &[Option<f64>], wanted: ExposureUse) -> Self {
        let count = stops.iter().flatten().count();
        let mean = stops.iter().flatten().sum::<f64>() / count.max(1) as f64;
        let gain =
            |stops: &Option<f64>| [stops.map_or(0.0, |s| ((s - mean) * std::f64::consts::LN_2) as f32); 3];
        let error = |stops: &Option<f64>| [if stops.is_some() { 0.0 } else { f32::INFINITY }; 3];
        let exposures =
            Exposures { gains: stops.iter().map(gain).collect(), falloff: vec![0.0; stops.len()] };
        match judge(Solved { exposures, errors: stops.iter().map(error).collect() }, wanted) {
            (Some(exposures), verdict) if count >= LEAST_PHOTOS => {
                Self { exposures, verdict: Some(verdict), passed: 0 }
            }
            _ => Self::default(),
        }
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

    /// Takes over what `photos` say.
    pub(super) fn update(&mut self, photos: &[Cells], wanted: ExposureUse) {
        let (exposures, verdict) = judge(solve(photos), wanted);
        self.exposures = exposures.unwrap_or_default();
        self.verdict = Some(verdict);
    }

    /// A photo as it is trained on, and the number of its correction, from 1; 0 for none.
    pub(super) fn correct(&self, index: usize, photo: Arc<RgbImage>) -> (Arc<RgbImage>, u32) {
        match self.exposures.correct(index, &photo) {
            Some(corrected) => (Arc::new(corrected), self.passed as u32 + 1),
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
    /// The estimates in `estimates` for photos with these names; `None` if there are none.
    pub(super) fn new<'a>(
        estimates: &ExposureEstimates,
        names: impl Iterator<Item = &'a str>,
    ) -> Option<Self> {
        let Exposures { gains, falloff } = &estimates.exposures;
        let photo = |((name, gains), falloff): ((&str, &[f32; 3]), &f32)| PhotoExposure {
            name: name.to_owned(),
            gains: *gains,
            falloff: *falloff,
        };
        let photos = names.zip(gains).zip(falloff).map(photo).collect();
        estimates.verdict.map(|verdict| Self { verdict, photos })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exif_data_are_the_first_guess_where_they_differ() {
        let stops = [-7.0, -7.0, -6.0, -6.0].map(Some);
        let estimates = ExposureEstimates::guessed(&[&stops[..], &[None]].concat(), ExposureUse::Auto);
        let half = 0.5 * std::f32::consts::LN_2;
        for (gains, wanted) in estimates.exposures.gains.iter().zip([-half, -half, half, half, 0.0]) {
            assert!(gains.iter().all(|gain| (gain - wanted).abs() < 1e-6), "{gains:?}");
        }
        assert_eq!((estimates.passed, estimates.exposures.falloff), (0, vec![0.0; 5]));
        assert_eq!(
            ExposureEstimates::guessed(&[Some(-7.0); 5], ExposureUse::Auto),
            ExposureEstimates::default()
        );
        assert_eq!(ExposureEstimates::guessed(&stops, ExposureUse::Off), ExposureEstimates::default());
        assert_eq!(
            ExposureEstimates::guessed(&stops[1..], ExposureUse::Auto),
            ExposureEstimates::default(),
            "too few"
        );
    }
}
