//! Corrects photos that differ in exposure, white balance and falloff towards the corners, at the
//! points that they track. Later stages get corrected photos, so colours and texels do not mix
//! exposures.

use super::views::Views;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::exposure::{
    ExposureDetails, ExposureUse, Exposures, Light, Strengths, solve,
};
use trisplat_scene::Result;
use trisplat_scene::report::Outcome;

/// Correction of the photos.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct ExposureOptions {
    /// Correct photos that differ in exposure and white balance, or are darker in their
    /// corners: auto (as the training did), on, off, or three shares
    pub exposure: ExposureUse,
}

impl ExposureOptions {
    /// As in the training of the scene.
    pub const DEFAULT: Self = Self { exposure: ExposureUse::Auto };
    /// Never.
    pub const OFF: Self = Self { exposure: ExposureUse::Off };
}

/// Corrects `views` at the points that they track, by the shares of `options` or else those of the
/// scene's training, `trained`.
///
/// # Errors
///
/// A photo that cannot be decoded.
pub(crate) fn exposure(
    trained: Option<[f32; 3]>,
    views: Option<&mut Views>,
    options: &ExposureOptions,
    details: &mut ExposureDetails,
) -> Result<Outcome<()>> {
    let Some(views) = views.filter(|views| !views.is_drawn()) else {
        return Ok(Outcome::Skipped("no photos were given"));
    };
    views.correct_by(Exposures::default());
    let trained = trained.map_or(Strengths::NONE, Strengths::from);
    let strengths = options.exposure.strengths().unwrap_or(trained);
    if strengths.is_none() {
        return Ok(Outcome::Skipped(match options.exposure {
            ExposureUse::Auto => {
                "the scene was trained on photos as they are (`exposure` on corrects them)"
            }
            _ => "`exposure` off",
        }));
    }
    let Some(tracked) = views.tracked.clone().filter(|_| !views.are_cut()) else {
        return Ok(Outcome::Skipped(
            "photos track too few points, or are of an object before nothing",
        ));
    };
    let all: Vec<usize> = (0..views.len()).collect();
    views.prefetch(&all);
    let mut lights = Vec::with_capacity(all.len());
    let mut sizes = Vec::with_capacity(all.len());
    for view in all {
        let photo = views.photo(view)?;
        sizes.push(photo.size);
        lights.push(Light::of_photo(&photo, &tracked[view]));
    }
    let solved = solve(&lights, &sizes);
    details.verdict = Some(solved.verdict(strengths));
    let Some(exposures) = solved.corrections(strengths) else {
        return Ok(Outcome::Skipped("there are no photos"));
    };
    details.exposures = exposures.clone();
    views.correct_by(exposures);
    Ok(Outcome::Changed(()))
}
