//! Colours from the photos: those of the pixels where a triangle is visible, now that it is opaque and hides what is
//! behind it.
//!
//! With z-buffered opaque triangles each sample of a photo belongs to one triangle, so the best corner
//! colours are a linear least-squares problem of three unknowns per triangle and channel, coupled only where
//! triangles share a pixel:
//!
//! ```text
//! minimise Σ_pixels (photo - drawn(e))² + λ Σ_triangles Σ_k (e_k - ē)²,   drawn = mean over samples of Σ_k b_k e_k
//! ```
//!
//! with b the perspective-correct barycentric weights of the corners, e the sRGB-encoded corner colours that are
//! sought and ē the triangle's mean colour, towards which corners are pulled that few photos show. Encoded values are
//! fitted because the error that counts is measured on them. Each pass draws the scene as an engine does, in linear
//! light with several samples per pixel, and solves a 3 x 3 system per triangle for the residuals, in which every
//! sample counts by itself. That system majorises the coupled one, so the error falls with every pass. One pass is
//! the default: the next ones gain 0.05 dB at most and cost SSIM, and with few photos they lose. In the first pass
//! the residual of a sample is partly that of its own colour, not of its pixel: the fewer photos, the more.
//!
//! Some photos are held out at first. They decide whether three colours per triangle are better than one, and whether
//! refitted colours are better than those the scene came with. Training has usually seen those photos, so what one
//! colour per triangle gains from seeing them is subtracted from the PSNR of the colours that are there. If they are
//! better even then, they stay.

mod evaluation;
mod fit;
mod gather;
mod options;

pub use options::{RefitColors, RefitOptions};

use super::views::{SAMPLES, Views};
use crate::error::Result;
use crate::math::median::median;
use crate::mesh::Mesh;
use crate::raster::solid::{Solid, SolidRasterOptions};
use crate::report::{Outcome, StageDetails};
use evaluation::{Evaluation, psnr_of};
use fit::Fit;
use gather::{Gatherer, Observation};

/// One photo in so many is held out at first, to evaluate on.
const EVALUATION_EVERY: usize = 8;
/// At most so many are held out.
const MOST_EVALUATION_VIEWS: usize = 24;
/// With so many photos the first pass is half coupled. Neighbours that share a pixel share its residual: with many
/// photos that is sharper; with few of them one triangle makes up for the error of another, which looks wrong from
/// elsewhere.
const HALF_COUPLED: f32 = 40.0;
/// A photo is out of line when its mean error is this far from the others', sRGB-encoded, and ...
const OUTLIER: f32 = 0.02;
/// ... this many times as far as half of them are.
const OUTLIER_SPREADS: f32 = 6.0;

/// What fitting did. Without held-out photos, or when `refit` names the colours, there is no PSNR.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct RefitDetails {
    /// PSNR of the colours the scene came with on held-out photos, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_before: Option<f64>,
    /// PSNR of one fitted colour per triangle on held-out photos, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_flat: Option<f64>,
    /// PSNR of three fitted colours per triangle on held-out photos, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_corner: Option<f64>,
    /// PSNR of one fitted colour per triangle on the same photos once they were fitted to as well, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_flat_seen: Option<f64>,
    /// By how much fitting raises the PSNR on photos that neither training nor fitting has seen, estimated, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_gain: Option<f64>,
    /// Photos left out because their mean error is far from that of the others; absent when there are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photos_out_of_line: Option<u64>,
    /// Triangles that photos see.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<u64>,
    /// Which colours the mesh got.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colors: Option<RefitColors>,
}

impl RefitDetails {
    fn record(&mut self, evaluation: &Evaluation, flat_seen: f64) {
        self.psnr_before = Some(evaluation.before);
        self.psnr_flat = Some(evaluation.flat);
        self.psnr_corner = Some(evaluation.corner);
        self.psnr_flat_seen = Some(flat_seen);
        self.psnr_gain = Some(evaluation.gain(flat_seen));
    }
}

impl StageDetails for RefitDetails {
    const STAGE: &'static str = "refit";
}

/// Fits the colours of `mesh` to `views`; `details` get the PSNR on held-out photos.
///
/// Errors: an option out of range, a photo that cannot be decoded.
pub fn refit(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    options: &RefitOptions,
    details: &mut RefitDetails,
) -> Result<Outcome<()>> {
    options.validate()?;
    let Some(views) = views.filter(|v| !v.is_empty()) else {
        return Ok(Outcome::Unneeded("no photos were given"));
    };
    if options.refit == RefitColors::Off {
        return Ok(Outcome::Unneeded("`refit` off"));
    }
    if !mesh.indices.is_empty() {
        return Ok(Outcome::Unneeded("a mesh with shared vertices keeps its colours"));
    }
    let every = EVALUATION_EVERY.max(views.len().div_ceil(MOST_EVALUATION_VIEWS));
    let (held_out, others): (Vec<usize>, Vec<usize>) = (0..views.len()).partition(|v| v % every == every / 2);

    let mut accumulator = Accumulator::new(mesh, views);
    let mut fit = Fit::new(mesh, options.refit_flatness as f32);
    let mut which =
        if options.refit == RefitColors::Corner { RefitColors::Corner } else { RefitColors::Flat };
    accumulator.add(mesh, views, &others, &mut fit, 1.0)?;
    let evaluation = match options.refit {
        RefitColors::Auto if !held_out.is_empty() => Some(Evaluation::new(mesh, views, &held_out, &fit)?),
        _ => None,
    };
    accumulator.add(mesh, views, &held_out, &mut fit, 1.0)?;
    if let Some(evaluation) = &evaluation {
        which = evaluation.best();
        let flat_seen = psnr_of(mesh, views, &held_out, fit.colors(RefitColors::Flat))?;
        details.record(evaluation, flat_seen);
        if evaluation.gain(flat_seen) < 0.0 {
            return Ok(Outcome::Unneeded("held-out photos match the colours that are there better"));
        }
    }
    let outliers = outliers(&accumulator.errors);
    if !outliers.is_empty() {
        // Photos of another exposure.
        accumulator.add(mesh, views, &outliers, &mut fit, -1.0)?;
        details.photos_out_of_line = Some(outliers.len() as u64);
    }
    details.fitted = Some(fit.fitted() as u64);
    let used: Vec<usize> = (0..views.len()).filter(|v| !outliers.contains(v)).collect();
    for _ in 1..options.refit_passes {
        fit.improve(which);
        accumulator.coupling = 1.0;
        accumulator.add(mesh, views, &used, &mut fit, 1.0)?;
    }
    mesh.colors = fit.colors(which);
    details.colors = Some(which);
    Ok(Outcome::Changed(()))
}

/// Renders the scene from one photo's place after the other, and adds what the photo shows to the normal equations.
struct Accumulator {
    solid: Solid,
    drawing: SolidRasterOptions,
    gatherer: Gatherer,
    coupling: f32,
    /// Mean error of each photo when it was last added, sRGB-encoded.
    errors: Vec<[f32; 3]>,
}

impl Accumulator {
    fn new(mesh: &Mesh, views: &Views) -> Self {
        Self {
            solid: Solid::new(),
            drawing: views.drawing(mesh, SAMPLES),
            gatherer: Gatherer::new(mesh.face_count()),
            coupling: views.len() as f32 / (views.len() as f32 + HALF_COUPLED),
            errors: vec![[0.0; 3]; views.len()],
        }
    }

    /// Adds the photos `chosen` to the sums of `fit`, in their order, with this sign: -1 takes them back.
    fn add(
        &mut self,
        mesh: &Mesh,
        views: &mut Views,
        chosen: &[usize],
        fit: &mut Fit,
        sign: f32,
    ) -> Result<()> {
        views.prefetch(chosen);
        for &view in chosen {
            let photo = views.photo(view)?;
            let camera = views.camera(view);
            let visibility = self.solid.visibility(mesh, camera, &self.drawing);
            let background = self.drawing.background;
            let seen =
                Observation { mesh, camera, photo: &photo, visibility, background, coupling: self.coupling };
            self.errors[view] = self.gatherer.gather(&seen, fit, sign);
        }
        Ok(())
    }
}

/// Photos whose mean error is far from what is usual: taken with another exposure, or of something else. None
/// when half of them are. `means` has one entry per photo.
fn outliers(means: &[[f32; 3]]) -> Vec<usize> {
    let median = |values| median(values, f32::total_cmp).unwrap_or(0.0);
    let limits = [0, 1, 2].map(|channel: usize| {
        let middle = median(means.iter().map(|mean| mean[channel]).collect());
        let spread = median(means.iter().map(|mean| (mean[channel] - middle).abs()).collect());
        (middle, OUTLIER.max(OUTLIER_SPREADS * spread))
    });
    let is_far =
        |v: &usize| means[*v].iter().zip(limits).any(|(e, (middle, most))| (e - middle).abs() > most);
    let far: Vec<usize> = (0..means.len()).filter(is_far).collect();
    if 2 * far.len() < means.len() { far } else { Vec::new() }
}
