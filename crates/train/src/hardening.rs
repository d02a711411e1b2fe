//! The constants of the anneal for two ways to become solid: that of preset `solid` and that of the paper.

use super::options::{TrainOptions, TrainPreset};

/// Prunes triangles that are too faint, from some step on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PruneFaint {
    /// From here on, steps of a 30,000-step run.
    pub(super) from_step: f64,
    /// Fainter triangles are pruned.
    pub(super) min_opacity: f64,
}

/// Prunes triangles that are too soft, from some step on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PruneSoft {
    /// From here on, steps of a 30,000-step run.
    pub(super) from_step: f64,
    /// Triangles of this σ and more are pruned.
    pub(super) max_sigma: f64,
}

/// How a run becomes solid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hardening {
    /// Steepness of the opacity's sigmoid at the end of the anneal, as a factor, reached log-linearly. It
    /// drives each opacity to 0 or 1, whichever lowers the loss.
    pub(super) opacity_gain: f64,
    /// Triangles fainter than this are pruned at the end of the anneal, reached linearly (TS 0.7).
    pub(super) prune_opacity: f64,
    /// τ_prune at the end of the anneal, reached linearly (TS+ 0.235).
    pub(super) prune_weight: f64,
    /// Prunes faint triangles.
    pub(super) prune_faint: [Option<PruneFaint>; 2],
    /// Prunes soft triangles.
    pub(super) prune_soft: Option<PruneSoft>,
    /// Factor of σ at the end of the anneal, reached log-linearly from the first step on (TS+ 0.0001,
    /// linearly).
    pub(super) sigma_scale: f64,
    /// Weight of the mean σ in the loss while annealing.
    pub(super) loss_sigma: f64,
    /// Weight of 1 / mean opacity in the loss while annealing.
    pub(super) loss_opacity: f64,
    /// Rate of the logarithm of σ while annealing, for a 30,000-step run; shorter runs get a higher rate, so
    /// that σ changes equally. None: that of the soft run.
    pub(super) sigma_rate: Option<f64>,
}

/// Share of the anneal after which preset `solid` prunes the faintest triangles.
const FAINT_FROM: f64 = 0.97;

impl Hardening {
    /// The constants for these options; unused when the scene stays soft.
    pub(super) fn of(options: &TrainOptions) -> Self {
        match options.preset {
            TrainPreset::PaperEngine => Self::PAPER,
            _ => Self::annealed(options.solid.opacity_until),
        }
    }

    /// By the anneal only, which ends at the position `until`.
    fn annealed(until: f64) -> Self {
        Self {
            opacity_gain: 8.0,
            prune_opacity: 0.05,
            prune_weight: 0.235,
            prune_faint: [Some(PruneFaint { from_step: FAINT_FROM * until, min_opacity: 0.4 }), None],
            prune_soft: None,
            sigma_scale: 0.02,
            loss_sigma: 0.0,
            loss_opacity: 0.0,
            sigma_rate: None,
        }
    }

    /// `train_game_engine.py` of the paper's code: losses drive σ down and opacity up, and faint or soft
    /// triangles are deleted.
    const PAPER: Self = Self {
        opacity_gain: 1.0,
        prune_opacity: 0.014,
        prune_weight: 0.022,
        prune_faint: [
            Some(PruneFaint { from_step: 25_000.0, min_opacity: 0.1 }),
            Some(PruneFaint { from_step: 29_000.0, min_opacity: 0.7 }),
        ],
        prune_soft: Some(PruneSoft { from_step: 28_000.0, max_sigma: 1.0 }),
        sigma_scale: 1.0,
        loss_sigma: 1.0,
        loss_opacity: 20.0,
        sigma_rate: Some(0.0008),
    };
}
