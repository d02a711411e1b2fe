//! Colours from the photos: each triangle takes them from the pixels where it is visible.
//!
//! With z-buffered opaque triangles each sample of a photo belongs to one triangle, so the best
//! corner colours are a linear least-squares problem of three unknowns per triangle and channel,
//! coupled only where triangles share a pixel:
//!
//! ```text
//! minimise Σ_pixels (photo - drawn(e))² + λ Σ_triangles Σ_k (e_k - ē)²,   drawn = mean over samples of Σ_k b_k e_k
//! ```
//!
//! with b the perspective-correct barycentric weights of the corners, e the sRGB-encoded corner
//! colours that are sought and ē the triangle's mean colour, which corners seen by few photos are
//! pulled to. Encoded values are fitted because scores are measured on them. Each pass draws the
//! scene as an engine does, in linear light with several samples per pixel, and solves a 3 x 3
//! system per triangle for the residuals, in which every sample counts by itself. That system
//! majorises the coupled one, so the error falls with every pass. One pass is the default: the next
//! ones gain 0.05 dB at most and cost SSIM, and with few photos they lose
//! (docs/benchmarks/history.md). In the first pass a part of a sample's residual is computed from
//! its own colour instead of its pixel's; this part is larger for fewer photos.
//!
//! Some photos are held out at first. They decide whether three colours per triangle are better
//! than one, and whether refitted colours are better than the scene's own. Training has usually
//! seen those photos. So the gain of one colour per triangle from seeing them is subtracted from
//! the PSNR of the scene's own colours. If these still score higher, they stay, except for channels
//! at 0 that photos contradict: a training that clamped them may have held them there (`revive` in
//! `equations.rs`).
//!
//! The backdrop is a surface of its own, whose colours are solved together: see `shell_colors.rs`.

use crate::views::Views;
pub(crate) use equations::{ColorFit, Equations};
use photo_equations::Accumulator;
pub(crate) use photo_equations::{Gatherer, PhotoObserver};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
pub(super) use shell_colors::smooth_shell;
use trisplat_scene::Result;
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::report::{Outcome, StageProgress};

mod equations;
mod options;
mod photo_equations;
mod shell_colors;

pub use options::{RefitColors, RefitOptions};

/// Progress of the stage when all photos but the held-out ones are added.
const OTHERS_PART: f64 = 0.7;
/// Progress of the stage when the held-out photos are evaluated.
const EVALUATED_PART: f64 = 0.85;
/// Minimum distance of an outlier's mean error from that of the other photos, sRGB-encoded.
const OUTLIER: f32 = 0.02;
/// Minimum distance of an outlier's mean error, as a multiple of the median distance.
const OUTLIER_SPREADS: f32 = 6.0;

/// The result of fitting. Without held-out photos, or when `refit` names the colours, there is no
/// PSNR.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
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
    /// The same after colours were fitted to these photos as well, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_flat_seen: Option<f64>,
    /// Estimated gain of PSNR on photos that neither training nor fitting has seen, dB.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_gain: Option<f64>,
    /// Photos left out because their mean error is far from that of the others; absent when there
    /// are none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub photos_out_of_line: Option<u64>,
    /// Triangles that photos see.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub fitted: Option<u64>,
    /// Triangles with a channel at 0 that got the photos' value, where the others keep the scene's
    /// own colours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub revived: Option<u64>,
    /// Colours of the mesh.
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

trisplat_scene::stage!(RefitDetails, "refit");

/// Result of fitting.
#[derive(Debug)]
pub struct Refitted {
    /// Changed, if the colours did.
    pub outcome: Outcome<()>,
    /// For stages that compare with these colours; none when nothing was fitted or no photo was
    /// held out.
    pub unseen: Option<UnseenColors>,
}

impl Refitted {
    fn skipped(why: &'static str) -> Self {
        Self { outcome: Outcome::Skipped(why), unseen: None }
    }
}

/// Colours that have not seen the photos which stages hold out.
#[derive(Debug)]
pub struct UnseenColors {
    /// Fitted to the other photos; those of the backdrop are its final ones, which are smooth and
    /// hardly know a photo.
    pub colors: Colors,
    /// Estimated PSNR on the held-out photos, dB, when the scene keeps its own colours.
    pub psnr_of_own: Option<f64>,
}

impl UnseenColors {
    /// The colours of `mesh` for its faces from `scene_faces` on.
    fn with_backdrop(self, mesh: &Mesh, scene_faces: usize) -> Self {
        if scene_faces == mesh.face_count() {
            return self;
        }
        let corners = |face: usize| match &self.colors {
            _ if face >= scene_faces => mesh.corner_colors(face),
            Colors::Face(colors) => [colors[face]; 3],
            Colors::Vertex(colors) => [0, 1, 2].map(|corner| colors[3 * face + corner]),
        };
        Self { colors: Colors::Vertex((0..mesh.face_count()).flat_map(corners).collect()), ..self }
    }
}

/// Fits the colours of `mesh`, whose faces from `scene_faces` on are its backdrop, to `views`;
/// `details` get the PSNR on held-out photos.
///
/// # Errors
///
/// An option out of range, a photo that cannot be decoded.
pub fn refit(
    mesh: &mut Mesh,
    scene_faces: usize,
    views: Option<&mut Views>,
    options: &RefitOptions,
    details: &mut RefitDetails,
    progress: &mut StageProgress<'_>,
) -> Result<Refitted> {
    options.validate()?;
    let Some(views) = views.filter(|v| !v.is_empty()) else {
        return Ok(Refitted::skipped("no photos were given"));
    };
    if options.refit == RefitColors::Off {
        return Ok(Refitted::skipped("`refit` off"));
    }
    if !mesh.indices.is_empty() {
        return Ok(Refitted::skipped("a mesh with shared vertices keeps its colours"));
    }
    let mut accumulator = Accumulator::new(mesh, views, options.refit_flatness as f32);
    let end_of_pass = |pass: u32| f64::from(pass) / f64::from(options.refit_passes);
    let mut first = progress.part(0.0, end_of_pass(1));
    let (which, unseen) =
        first_pass(mesh, views, options.refit, &mut accumulator, details, &mut first)?;
    let Some(which) = which else {
        // The note is about the scene's own colours, which were trained.
        let revived = accumulator.fit.revive(mesh, scene_faces);
        shell_colors::paint(mesh, scene_faces, &accumulator.fit);
        details.revived = (revived > 0).then_some(revived);
        let outcome = if scene_faces < mesh.face_count() || revived > 0 {
            Outcome::Changed(())
        } else {
            Outcome::Skipped("held-out photos match the present colours better")
        };
        return Ok(Refitted {
            outcome,
            unseen: unseen.map(|unseen| unseen.with_backdrop(mesh, scene_faces)),
        });
    };
    let outliers = outliers(&accumulator.errors);
    if !outliers.is_empty() {
        // Photos of another exposure.
        accumulator.add(mesh, views, &outliers, -1.0, first.part(1.0, 1.0))?;
        details.photos_out_of_line = Some(outliers.len() as u64);
    }
    details.fitted = Some(accumulator.fit.visible_triangles() as u64);
    let used: Vec<usize> = (0..views.len()).filter(|v| !outliers.contains(v)).collect();
    for pass in 1..options.refit_passes {
        accumulator.fit.improve(which);
        accumulator.observer.coupling = 1.0;
        let progress = progress.part(end_of_pass(pass), end_of_pass(pass + 1));
        accumulator.add(mesh, views, &used, 1.0, progress)?;
    }
    mesh.colors = accumulator.fit.colors(which);
    shell_colors::paint(mesh, scene_faces, &accumulator.fit);
    details.colors = Some(which);
    let unseen = unseen.map(|unseen| unseen.with_backdrop(mesh, scene_faces));
    Ok(Refitted { outcome: Outcome::Changed(()), unseen })
}

/// Adds all photos, held-out ones last. Returns which colours to fit, `None` when the scene's own
/// are better, and the best of those that were fitted before the held-out photos were added.
fn first_pass(
    mesh: &mut Mesh,
    views: &mut Views,
    colors: RefitColors,
    accumulator: &mut Accumulator,
    details: &mut RefitDetails,
    progress: &mut StageProgress<'_>,
) -> Result<(Option<RefitColors>, Option<UnseenColors>)> {
    let (held_out, others) = views.held_out();
    accumulator.add(mesh, views, &others, 1.0, progress.part(0.0, OTHERS_PART))?;
    let evaluation = match colors {
        RefitColors::Auto if !held_out.is_empty() => {
            Some(Evaluation::new(mesh, views, &held_out, &accumulator.fit)?)
        }
        _ => None,
    };
    let given = if colors == RefitColors::Corner { colors } else { RefitColors::Flat };
    let which = evaluation.as_ref().map_or(given, Evaluation::best);
    let colors = (!held_out.is_empty()).then(|| accumulator.fit.colors(which));
    accumulator.add(mesh, views, &held_out, 1.0, progress.part(EVALUATED_PART, 1.0))?;
    let unseen = |psnr_of_own| colors.map(|colors| UnseenColors { colors, psnr_of_own });
    let Some(evaluation) = evaluation else {
        return Ok((Some(which), unseen(None)));
    };
    let flat_seen = psnr_of(mesh, views, &held_out, accumulator.fit.colors(RefitColors::Flat))?;
    details.record(&evaluation, flat_seen);
    let is_better = !(evaluation.gain(flat_seen) < 0.0);
    Ok(if is_better {
        (Some(which), unseen(None))
    } else {
        (None, unseen(Some(evaluation.unseen_before(flat_seen))))
    })
}

/// Photos whose mean error is unusual: taken with another exposure, or of something else. None when
/// half of all are. `means` has one entry per photo.
fn outliers(means: &[[f32; 3]]) -> Vec<usize> {
    let median = |values| median(values, f32::total_cmp).unwrap_or(0.0);
    let limits = [0, 1, 2].map(|channel: usize| {
        let middle = median(means.iter().map(|mean| mean[channel]).collect());
        let spread = median(means.iter().map(|mean| (mean[channel] - middle).abs()).collect());
        (middle, OUTLIER.max(OUTLIER_SPREADS * spread))
    });
    let is_far = |v: &usize| {
        means[*v].iter().zip(limits).any(|(e, (middle, most))| (e - middle).abs() > most)
    };
    let far: Vec<usize> = (0..means.len()).filter(is_far).collect();
    if 2 * far.len() < means.len() { far } else { Vec::new() }
}

// ---- Scores of colours on photos that the fit has not seen, and the choice of the best colours

/// PSNR on held-out photos, dB.
pub(super) struct Evaluation {
    /// Of the scene's own colours; training has usually seen these photos.
    pub(super) before: f64,
    /// Of one fitted colour per triangle.
    pub(super) flat: f64,
    /// Of three fitted colours per triangle.
    pub(super) corner: f64,
}

impl Evaluation {
    /// Evaluates `fit` on the photos `held_out`, which it has not seen.
    fn new(mesh: &mut Mesh, views: &mut Views, held_out: &[usize], fit: &ColorFit) -> Result<Self> {
        Ok(Self {
            before: views.mean_psnr(mesh, held_out)?,
            flat: psnr_of(mesh, views, held_out, fit.colors(RefitColors::Flat))?,
            corner: psnr_of(mesh, views, held_out, fit.colors(RefitColors::Corner))?,
        })
    }

    pub(super) fn best(&self) -> RefitColors {
        if self.flat > self.corner { RefitColors::Flat } else { RefitColors::Corner }
    }

    /// The estimated gain of the best fitted colours on photos that neither training nor fitting
    /// has seen.
    pub(super) fn gain(&self, flat_seen: f64) -> f64 {
        self.flat.max(self.corner) - self.unseen_before(flat_seen)
    }

    /// Estimated PSNR of the scene's own colours, had they not seen the held-out photos.
    /// `flat_seen` is the PSNR of flat colours after fitting to these as well: the scene's own are
    /// assumed to gain as much from having seen them.
    pub(super) fn unseen_before(&self, flat_seen: f64) -> f64 {
        self.before - (flat_seen - self.flat).max(0.0)
    }
}

/// PSNR of `colors` on the photos `held_out`, dB.
pub(super) fn psnr_of(
    mesh: &mut Mesh,
    views: &mut Views,
    held_out: &[usize],
    colors: Colors,
) -> Result<f64> {
    let kept = std::mem::replace(&mut mesh.colors, colors);
    let psnr = views.mean_psnr(mesh, held_out);
    mesh.colors = kept;
    psnr
}
