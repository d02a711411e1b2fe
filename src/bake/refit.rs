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
//! the error falls with every pass. One pass is the default: the next ones gain 0.05 dB at most and cost SSIM,
//! and with few photos they lose. In the first pass a sample is pulled partly by what its own colour lacks, not
//! its pixel: the fewer photos, the more.
//!
//! Some photos are left out at first and tell whether three colours a triangle are better than one, and whether
//! refitted colours are better than those the scene came with. Whoever trained the scene has usually seen those
//! photos, so the colours that are there are debited what one colour a triangle gains from seeing them. If they
//! are better even then, they stay.

mod fit;
mod gather;

use super::Details;
use super::unseen::mean_psnr;
use super::views::Views;
use crate::error::{Error, Result};
use crate::math::median::median;
use crate::mesh::{Colors, Mesh};
use crate::raster::solid::{Solid, SolidRasterOptions};
use crate::report::Outcome;
use fit::Fit;
use gather::{Gatherer, Shot};

/// One photo in so many is left out at first, to judge on.
const JUDGE_EVERY: usize = 8;
/// At most so many.
const MOST_JUDGES: usize = 24;
/// With so many photos the first pass is half coupled. Neighbours that share a pixel share what it lacks: with
/// many photos that is sharper, with few of them one triangle makes up for what another lacks, which views from
/// elsewhere do not forgive.
const HALF_COUPLED: f32 = 40.0;
/// Samples a pixel along each axis.
const SAMPLES: u32 = 2;
/// A photo is out of line when its mean error is this far from the others', sRGB-encoded, and ...
const OUTLIER: f32 = 0.02;
/// ... this many times as far as half of them are.
const OUTLIER_SPREADS: f32 = 6.0;

/// Which colours are fitted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
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
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct RefitOptions {
    /// Which colours are fitted to the photos
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = RefitOptions::DEFAULT.refit, value_name = "WHICH"))]
    pub refit: RefitColors,
    /// λ: corners are drawn to their triangle's mean colour as if it had been seen on this many pixels more
    #[cfg_attr(feature = "cli", arg(long, default_value_t = RefitOptions::DEFAULT.refit_flatness, value_name = "PX"))]
    #[schemars(range(min = 0.0))]
    pub refit_flatness: f64,
    /// Passes over the photos
    #[cfg_attr(feature = "cli", arg(long, default_value_t = RefitOptions::DEFAULT.refit_passes, value_name = "N"))]
    pub refit_passes: u32,
}

impl RefitOptions {
    /// Looks what is best.
    pub const DEFAULT: Self = Self { refit: RefitColors::Auto, refit_flatness: 4.0, refit_passes: 1 };
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
    check(options)?;
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
    let every = JUDGE_EVERY.max(views.len().div_ceil(MOST_JUDGES));
    let judges: Vec<usize> = all.iter().copied().filter(|v| v % every == every / 2).collect();
    let others: Vec<usize> = all.iter().copied().filter(|v| !judges.contains(v)).collect();

    let mut looking = Looking::new(mesh, views);
    let mut fit = Fit::new(mesh, options.refit_flatness as f32);
    let mut which =
        if options.refit == RefitColors::Corner { RefitColors::Corner } else { RefitColors::Flat };
    looking.add(mesh, views, &others, &mut fit, 1.0)?;
    let without = match options.refit {
        RefitColors::Auto if !judges.is_empty() => Some(Judged::new(mesh, views, &judges, &fit)?),
        _ => None,
    };
    looking.add(mesh, views, &judges, &mut fit, 1.0)?;
    if let Some(without) = &without {
        which = without.better();
        let seen = psnr_of(mesh, views, &judges, fit.colors(RefitColors::Flat))?;
        without.tell(seen, details);
        if without.gain(seen) < 0.0 {
            return Ok(Outcome::Unneeded("photos left out are met better by the colours that are there"));
        }
    }
    let odd = outliers(&all, &looking.errors);
    if !odd.is_empty() {
        // Photos of another exposure.
        looking.add(mesh, views, &odd, &mut fit, -1.0)?;
        details.insert("photos_out_of_line".into(), odd.len().into());
    }
    details.insert("fitted".into(), fit.fitted().into());
    let used: Vec<usize> = all.into_iter().filter(|v| !odd.contains(v)).collect();
    for _ in 1..options.refit_passes {
        fit.improve(which);
        looking.coupling = 1.0;
        looking.add(mesh, views, &used, &mut fit, 1.0)?;
    }
    mesh.colors = fit.colors(which);
    details.insert("colors".into(), serde_json::to_value(which).unwrap_or_default());
    Ok(Outcome::Changed(()))
}

fn check(options: &RefitOptions) -> Result<()> {
    if !(options.refit_flatness >= 0.0 && options.refit_flatness.is_finite()) {
        return Err(Error::invalid("--refit-flatness", options.refit_flatness, "0 or more"));
    }
    if options.refit_passes == 0 {
        return Err(Error::invalid("--refit-passes", 0, "1 or more, or --refit off"));
    }
    Ok(())
}

/// Photo after photo: draws what it sees and sums what it says.
struct Looking {
    solid: Solid,
    drawing: SolidRasterOptions,
    gatherer: Gatherer,
    coupling: f32,
    /// Mean error of each photo when it was last looked at, sRGB-encoded.
    errors: Vec<[f32; 3]>,
}

impl Looking {
    fn new(mesh: &Mesh, views: &Views) -> Self {
        Self {
            solid: Solid::new(),
            drawing: views.drawing(mesh, SAMPLES),
            gatherer: Gatherer::new(mesh.face_count()),
            coupling: views.len() as f32 / (views.len() as f32 + HALF_COUPLED),
            errors: vec![[0.0; 3]; views.len()],
        }
    }

    /// Adds what some photos say to the sums of `fit`, in their order, so many times: -1 takes it back.
    fn add(
        &mut self,
        mesh: &Mesh,
        views: &mut Views,
        chosen: &[usize],
        fit: &mut Fit,
        times: f32,
    ) -> Result<()> {
        views.expect(chosen);
        for &view in chosen {
            let photo = views.photo(view)?;
            let camera = views.camera(view);
            let visibility = self.solid.visibility(mesh, camera, &self.drawing);
            let background = self.drawing.background;
            let shot = Shot { mesh, camera, photo: &photo, visibility, background, coupling: self.coupling };
            self.errors[view] = self.gatherer.gather(&shot, fit, times);
        }
        Ok(())
    }
}

/// How well photos are met that the fit has not seen, dB.
struct Judged {
    /// By the colours that are there, whose trainer has usually seen them.
    before: f64,
    flat: f64,
    corner: f64,
}

impl Judged {
    fn new(mesh: &mut Mesh, views: &mut Views, judges: &[usize], fit: &Fit) -> Result<Self> {
        Ok(Self {
            before: mean_psnr(mesh, views, judges)?,
            flat: psnr_of(mesh, views, judges, fit.colors(RefitColors::Flat))?,
            corner: psnr_of(mesh, views, judges, fit.colors(RefitColors::Corner))?,
        })
    }

    fn better(&self) -> RefitColors {
        if self.flat > self.corner { RefitColors::Flat } else { RefitColors::Corner }
    }

    /// What the better ones gain on photos that neither trainer nor fit have seen, when `seen` is how well the
    /// judges are met by flat colours that were fitted to them too.
    fn gain(&self, seen: f64) -> f64 {
        let unseen_before = self.before - (seen - self.flat).max(0.0);
        self.flat.max(self.corner) - unseen_before
    }

    fn tell(&self, seen: f64, details: &mut Details) {
        let figures = [
            ("psnr_before", self.before),
            ("psnr_flat", self.flat),
            ("psnr_corner", self.corner),
            ("psnr_flat_seen", seen),
            ("psnr_gain", self.gain(seen)),
        ];
        figures.into_iter().for_each(|(name, value)| drop(details.insert(name.into(), value.into())));
    }
}

/// How well `judges` are met by `colors`, dB.
fn psnr_of(mesh: &mut Mesh, views: &mut Views, judges: &[usize], colors: Colors) -> Result<f64> {
    let kept = std::mem::replace(&mut mesh.colors, colors);
    let psnr = mean_psnr(mesh, views, judges);
    mesh.colors = kept;
    psnr
}

/// Photos whose mean error is far from what is usual: taken with another exposure, or of something else. None
/// when half of them are.
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
    let odd: Vec<usize> = views.iter().copied().filter(is_odd).collect();
    if 2 * odd.len() < views.len() { odd } else { Vec::new() }
}
