//! Scores of colours on photos that the fit has not seen, and the choice of the best colours.

use super::equations::Fit;
use super::options::RefitColors;
use crate::views::Views;
use trisplat_scene::{
    Result,
    mesh::{Colors, Mesh},
};

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
    pub(super) fn new(mesh: &mut Mesh, views: &mut Views, held_out: &[usize], fit: &Fit) -> Result<Self> {
        Ok(Self {
            before: views.mean_psnr(mesh, held_out)?,
            flat: psnr_of(mesh, views, held_out, fit.colors(RefitColors::Flat))?,
            corner: psnr_of(mesh, views, held_out, fit.colors(RefitColors::Corner))?,
        })
    }

    pub(super) fn best(&self) -> RefitColors {
        if self.flat > self.corner { RefitColors::Flat } else { RefitColors::Corner }
    }

    /// The estimated gain of the best fitted colours on photos that neither training nor fitting has seen.
    pub(super) fn gain(&self, flat_seen: f64) -> f64 {
        self.flat.max(self.corner) - self.unseen_before(flat_seen)
    }

    /// Estimated PSNR of the scene's own colours, had they not seen the held-out photos. `flat_seen` is the PSNR of flat
    /// colours after fitting to these as well: the scene's own are assumed to gain as much from having seen them.
    pub(super) fn unseen_before(&self, flat_seen: f64) -> f64 {
        self.before - (flat_seen - self.flat).max(0.0)
    }
}

/// PSNR of `colors` on the photos `held_out`, dB.
pub(super) fn psnr_of(mesh: &mut Mesh, views: &mut Views, held_out: &[usize], colors: Colors) -> Result<f64> {
    let kept = std::mem::replace(&mut mesh.colors, colors);
    let psnr = views.mean_psnr(mesh, held_out);
    mesh.colors = kept;
    psnr
}
