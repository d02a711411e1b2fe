//! Finds how photos differ in exposure, white balance and falloff towards the corners, at the points that they track or beside
//! drawings of the scene. Later stages get corrected photos, so colours and texels do not mix exposures.

use super::views::{SAMPLES, Views};
use std::sync::Arc;
use trisplat_dataset::exposure::{
    ExposureDetails, ExposureUse, Exposures, Light, compared_size, judge, solve,
};
use trisplat_raster::solid::SolidRasterizer;
use trisplat_scene::Result;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::report::Outcome;

/// Fewer photos do not determine a mean exposure.
const LEAST_PHOTOS: usize = 4;

/// Whether photos are corrected.
#[derive(
    Debug, Clone, PartialEq, Eq, Default, serde::Serialize, serde::Deserialize, schemars::JsonSchema,
)]
#[serde(deny_unknown_fields, default)]
pub struct ExposureOptions {
    /// Whether to correct photos that differ in exposure and white balance, or are darker in their corners
    pub exposure: ExposureUse,
}

impl ExposureOptions {
    /// Where their light differs.
    pub const DEFAULT: Self = Self { exposure: ExposureUse::Auto };
    /// Never.
    pub const OFF: Self = Self { exposure: ExposureUse::Off };
}

/// Corrects `views` by the points that they track or, without, by drawings of `mesh`.
///
/// Errors: a photo that cannot be decoded.
pub(crate) fn exposure(
    mesh: &Mesh,
    views: Option<&mut Views>,
    options: &ExposureOptions,
    details: &mut ExposureDetails,
) -> Result<Outcome<()>> {
    let Some(views) = views.filter(|views| !views.is_drawn()) else {
        return Ok(Outcome::Skipped("no photos were given"));
    };
    views.correct_by(Exposures::default());
    if options.exposure == ExposureUse::Off {
        return Ok(Outcome::Skipped("`exposure` off"));
    }
    if views.are_cut() || views.len() < LEAST_PHOTOS {
        return Ok(Outcome::Skipped("there are too few photos, or they are of an object before nothing"));
    }
    let drawing = views.drawing(mesh, SAMPLES);
    let mut solid = SolidRasterizer::new();
    let all: Vec<usize> = (0..views.len()).collect();
    views.prefetch(&all);
    let (mut lights, mut sizes) = (Vec::with_capacity(all.len()), Vec::with_capacity(all.len()));
    for view in all {
        let photo = views.photo(view)?;
        let size = compared_size(photo.size);
        let small = Arc::clone(&photo).shared_at(size);
        lights.push(match &views.tracked {
            Some(tracked) => Light::at_points(&small, &tracked[view]),
            None => {
                let drawn = solid.render(mesh, &views.camera(view).resized(size), &drawing);
                Light::beside_drawing(&small, &drawn)
            }
        });
        sizes.push(photo.size);
    }
    let (exposures, verdict) = judge(solve(&lights, &sizes), options.exposure);
    details.verdict = Some(verdict);
    let Some(exposures) = exposures else {
        return Ok(Outcome::Skipped(
            "photos differ by less than 15% in exposure: they are taken as they are",
        ));
    };
    details.exposures = exposures.clone();
    views.correct_by(exposures);
    Ok(Outcome::Changed(()))
}
