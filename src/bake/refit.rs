//! Colours from the photos: what every triangle shows there, once it is opaque and hides what is behind it.
//!
//! With z-buffered opaque triangles each sample of a photo belongs to one triangle, so the best corner
//! colours are a linear least-squares problem of three unknowns a triangle and channel, coupled only where
//! triangles share a pixel:
//!
//! ```text
//! minimise Σ_pixels (photo - drawn(e))² + λ Σ_triangles Σ_k (e_k - ē)²,   drawn = mean over samples of Σ_k b_k e_k
//! ```
//!
//! with b the perspective-correct weights of the corners, e the sRGB-encoded corner colours that are sought
//! and ē the triangle's mean colour, towards which corners are drawn that photos tell little about. Encoded
//! values are fitted because the error that counts is measured on them. Each pass draws the scene as an
//! engine does, in linear light with several samples a pixel, and sends what is left of the error through a
//! 3 x 3 system a triangle in which every sample counts by itself. That system majorises the coupled one, so
//! the error falls with every pass.
//!
//! Some photos are left out at first and tell whether three colours a triangle are better than one, and whether
//! refitted colours are better than those the scene came with. Whoever trained the scene has usually seen those
//! photos, so refitted colours are credited half of what seeing them would gain. If they are not better even
//! then, the colours stay.

mod fit;
mod gather;

use super::Details;
use super::unseen::mean_psnr;
use super::views::Views;
use crate::error::{Error, Result};
use crate::math::median::median;
use crate::mesh::Mesh;
use crate::raster::solid::{Solid, SolidOptions};
use crate::report::Outcome;
use fit::Fit;
use gather::{Gatherer, Shot};

/// One photo in so many is left out at first, to judge on.
const JUDGE_EVERY: usize = 8;
/// Samples a pixel along each axis.
const SAMPLES: u32 = 2;
/// A photo is out of line when its mean error is this far from the others', sRGB-encoded, and ...
const OUTLIER: f32 = 0.02;
/// ... this many times as far as half of them are.
const OUTLIER_SPREADS: f32 = 6.0;

/// Which colours are fitted.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    clap::ValueEnum,
    serde::Serialize,
    serde::Deserialize,
    schemars::JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum RefitColors {
    /// Whatever is best on photos left out: one colour a triangle, three, or none
    Auto,
    /// One colour a triangle
    Flat,
    /// One colour a corner
    Corner,
    /// Colours stay as they are
    Off,
}

/// How colours are taken from the photos.
#[derive(Debug, Clone, PartialEq, clap::Args, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RefitOptions {
    /// Which colours are fitted to the photos
    #[arg(long, value_enum, default_value_t = RefitOptions::DEFAULT.refit, value_name = "WHICH")]
    pub refit: RefitColors,
    /// λ: corners are drawn to their triangle's mean colour as if it had been seen on this many pixels more
    #[arg(long, default_value_t = RefitOptions::DEFAULT.refit_flatness, value_name = "PX")]
    #[schemars(range(min = 0.0))]
    pub refit_flatness: f64,
    /// Passes over the photos
    #[arg(long, default_value_t = RefitOptions::DEFAULT.refit_passes, value_name = "N")]
    pub refit_passes: u32,
}

impl RefitOptions {
    /// Looks what is best.
    pub const DEFAULT: Self = Self { refit: RefitColors::Auto, refit_flatness: 4.0, refit_passes: 3 };
}

impl Default for RefitOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// Fits the colours of `mesh` to `views`; `details` tells the PSNR on photos left out.
///
/// Errors: an option out of range, a photo that cannot be decoded.
pub fn refit(
    mesh: &mut Mesh,
    views: Option<&mut Views>,
    options: &RefitOptions,
    details: &mut Details,
) -> Result<Outcome<()>> {
    if !(options.refit_flatness >= 0.0 && options.refit_flatness.is_finite()) {
        return Err(Error::invalid("--refit-flatness", options.refit_flatness, "0 or more"));
    }
    if options.refit_passes == 0 {
        return Err(Error::invalid("--refit-passes", 0, "1 or more, or --refit off"));
    }
    let Some(views) = views.filter(|v| !v.is_empty()) else {
        return Ok(Outcome::Unneeded("no photos were given"));
    };
    if options.refit == RefitColors::Off {
        return Ok(Outcome::Unneeded("--refit off"));
    }
    if !mesh.indices.is_empty() {
        return Ok(Outcome::Unneeded("a mesh with shared vertices keeps its colours"));
    }
    let all: Vec<usize> = (0..views.len()).collect();
    let judges: Vec<usize> = all.iter().copied().filter(|v| v % JUDGE_EVERY == JUDGE_EVERY / 2).collect();
    let others: Vec<usize> = all.iter().copied().filter(|v| !judges.contains(v)).collect();

    let mut looking = Looking::new(mesh, views);
    let mut fit = Fit::new(mesh, options.refit_flatness as f32);
    looking.add(mesh, views, &others, &mut fit)?;
    let (which, without) = match options.refit {
        RefitColors::Auto if !judges.is_empty() => choose(mesh, views, &judges, &fit, details)?,
        RefitColors::Flat => (RefitColors::Flat, f64::INFINITY),
        _ => (RefitColors::Corner, f64::INFINITY),
    };
    looking.add(mesh, views, &judges, &mut fit)?;
    if without.is_finite() {
        let before = mean_psnr(mesh, views, &judges)?;
        let with = psnr_of(mesh, views, &judges, &fit, which)?;
        details.insert("psnr_before".into(), before.into());
        details.insert("psnr_seen".into(), with.into());
        if (without + with) / 2.0 < before {
            return Ok(Outcome::Unneeded("photos left out are met better by the colours that are there"));
        }
    }
    let odd = outliers(&all, &looking.errors);
    let mut used = all;
    if !odd.is_empty() && odd.len() < used.len() {
        // Photos of another exposure are left out, and the first pass is made again without them.
        used.retain(|v| !odd.contains(v));
        fit.clear();
        looking.add(mesh, views, &used, &mut fit)?;
        details.insert("photos_out_of_line".into(), odd.len().into());
    }
    details.insert("fitted".into(), fit.fitted().into());
    fit.improve(which);
    for _ in 1..options.refit_passes {
        fit.clear();
        looking.add(mesh, views, &used, &mut fit)?;
        fit.improve(which);
    }
    mesh.colors = fit.colors(which);
    details.insert("colors".into(), serde_json::to_value(which).unwrap_or_default());
    Ok(Outcome::Changed(()))
}

/// Photo after photo: draws what it sees and sums what it says.
struct Looking {
    solid: Solid,
    drawing: SolidOptions,
    gatherer: Gatherer,
    /// Mean error of each photo when it was last looked at, sRGB-encoded.
    errors: Vec<[f32; 3]>,
}

impl Looking {
    fn new(mesh: &Mesh, views: &Views) -> Self {
        Self {
            solid: Solid::new(),
            drawing: views.drawing(mesh, SAMPLES),
            gatherer: Gatherer::new(mesh.face_count()),
            errors: vec![[0.0; 3]; views.len()],
        }
    }

    /// Adds what some photos say to the sums of `fit`, in their order.
    fn add(&mut self, mesh: &Mesh, views: &mut Views, chosen: &[usize], fit: &mut Fit) -> Result<()> {
        views.expect(chosen);
        for &view in chosen {
            let photo = views.photo(view)?;
            let camera = views.camera(view);
            let visibility = self.solid.visibility(mesh, camera, &self.drawing);
            let background = self.drawing.background;
            let shot = Shot { mesh, camera, photo: &photo, visibility, background };
            self.errors[view] = self.gatherer.gather(&shot, fit);
        }
        Ok(())
    }
}

/// Which refitted colours are best on `judges`, which `fit` has not seen, and how well they meet them, dB.
fn choose(
    mesh: &mut Mesh,
    views: &mut Views,
    judges: &[usize],
    fit: &Fit,
    details: &mut Details,
) -> Result<(RefitColors, f64)> {
    let flat = psnr_of(mesh, views, judges, fit, RefitColors::Flat)?;
    let corner = psnr_of(mesh, views, judges, fit, RefitColors::Corner)?;
    details.insert("psnr_flat".into(), flat.into());
    details.insert("psnr_corner".into(), corner.into());
    Ok(if flat > corner { (RefitColors::Flat, flat) } else { (RefitColors::Corner, corner) })
}

/// How well `judges` are met by the colours that `fit` would give next, dB.
fn psnr_of(
    mesh: &mut Mesh,
    views: &mut Views,
    judges: &[usize],
    fit: &Fit,
    which: RefitColors,
) -> Result<f64> {
    let mut candidate = fit.clone();
    candidate.improve(which);
    let kept = std::mem::replace(&mut mesh.colors, candidate.colors(which));
    let psnr = mean_psnr(mesh, views, judges);
    mesh.colors = kept;
    psnr
}

/// Photos whose mean error is far from what is usual: taken with another exposure, or of something else.
fn outliers(views: &[usize], means: &[[f32; 3]]) -> Vec<usize> {
    let median = |values| median(values, f32::total_cmp).unwrap_or(0.0);
    let limits = [0, 1, 2].map(|channel: usize| {
        let of = |&v: &usize| means[v][channel];
        let middle = median(views.iter().map(of).collect());
        let spread = median(views.iter().map(|v| (of(v) - middle).abs()).collect());
        (middle, OUTLIER.max(OUTLIER_SPREADS * spread))
    });
    let is_odd =
        |v: &usize| means[*v].iter().zip(limits).any(|(e, (middle, most))| (e - middle).abs() > most);
    views.iter().copied().filter(is_odd).collect()
}
