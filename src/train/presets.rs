//! The presets, one per kind of scene: outdoor in full, the others by what differs from it.

use super::options::{
    InitOptions, LossOptions, PruneFaint, PruneSoft, RateOptions, RefineOptions, SampleWeight,
    SolidifyOptions, TrainDrawOptions, TrainOptions, TrainPreset, WarmupOptions,
};

impl TrainOptions {
    /// The options of a preset.
    pub const fn preset(preset: TrainPreset) -> Self {
        match preset {
            TrainPreset::Outdoor => OUTDOOR,
            TrainPreset::Indoor => INDOOR,
            TrainPreset::Solid => SOLID,
            TrainPreset::PaperEngine => PAPER_ENGINE,
        }
    }
}

impl TrainOptions {
    /// The options of a preset for a run that starts from a trained scene in place of points: no small photos first,
    /// all degrees of view-dependent colour at once, corners that move less, and the anneal from the first step on.
    pub fn from_scene(preset: TrainPreset) -> Self {
        let base = Self::preset(preset);
        let rates = RateOptions { vertices: 0.3 * base.rates.vertices, sh_every: 0.0, ..base.rates };
        let warmup = WarmupOptions { quarter_until: 0.0, half_until: 0.0, ..base.warmup };
        match preset {
            TrainPreset::Solid => Self {
                steps: 4000,
                sh_degree: 3,
                rates,
                warmup,
                solid: SolidifyOptions {
                    opacity_from: 0.0,
                    opacity_until: HARDENED,
                    prune_faint: [
                        PruneFaint { from_step: 0.97 * HARDENED, min_opacity: 0.4 },
                        PruneFaint::NEVER,
                    ],
                    sigma_until: HARDENED,
                    engine_shading_from: HARDENED,
                    opaque_from: HARDENED,
                    ..base.solid
                },
                ..base
            },
            _ => Self { rates, warmup, ..base },
        }
    }
}

/// Where a scene that was soft has become opaque, steps of a 30,000-step run.
const HARDENED: f64 = 12_000.0;

const OUTDOOR: TrainOptions = TrainOptions {
    preset: TrainPreset::Outdoor,
    steps: 5000,
    max_triangles: 60_000,
    sh_degree: 3,
    seed: 0,
    milestones: [0; 4],
    draw: TrainDrawOptions {
        sort_per_pixel: false,
        exact_incenter: true,
        sigmoid_window: false,
        near: 0.01,
        fade_px: 0.5,
    },
    init: InitOptions {
        size: 2.2,
        sigma: 1.16,
        opacity: 0.28,
        dome_share: 0.0,
        dome_radius: 1.0,
        shell_subdivisions: 4,
        random_points: 10_000,
    },
    loss: LossOptions {
        dssim: 0.2,
        opacity: 0.0055,
        distortion: 0.0,
        normal: 0.0,
        size: 1e-8,
        geometry_from: 5000.0,
        size_until: 25_000.0,
    },
    rates: RateOptions {
        vertices: 0.003,
        vertices_final_share: 0.01,
        opacity: 0.03,
        sigma: 0.0008,
        sh: 0.008,
        sh_rest: 0.05,
        final_share: 1.0,
        sparse: true,
        sh_every: 1000.0,
    },
    refine: RefineOptions {
        from: 500.0,
        until: 25_000.0,
        every: 500.0,
        growth: 0.3,
        sample_by: SampleWeight::Alternating,
        relocate: 0.0,
        split_px: 12.0,
        clone_shift: 1.5,
        prune_weight: 0.022,
        prune_opacity: 0.014,
        min_views: 2,
    },
    warmup: WarmupOptions { quarter_until: 12_000.0, half_until: 24_000.0, min_px: 64 },
    solid: SolidifyOptions {
        enabled: false,
        opacity_from: 5000.0,
        opacity_until: 24_000.0,
        opacity_floor: 0.0,
        opacity_gain: 8.0,
        prune_opacity: 0.5,
        prune_faint: [PruneFaint::NEVER; 2],
        loss_sigma: 0.0,
        loss_opacity: 0.0,
        loss_square: 0.0,
        rate_sigma: 0.0,
        prune_soft: PruneSoft::NEVER,
        sigma_from: 0.0,
        sigma_until: 24_000.0,
        sigma_scale: 0.02,
        prune_weight: 0.235,
        engine_shading_from: 24_000.0,
        opaque_from: 24_000.0,
        samples_per_axis: 1,
        edge_width_samples: 1.0,
        linear_blending: true,
        vertices_rate_scale: 1.0,
        vertices_final_share: 0.1,
    },
};

const INDOOR: TrainOptions = TrainOptions {
    preset: TrainPreset::Indoor,
    loss: LossOptions { dssim: 0.4, distortion: 1.0, normal: 0.00004, size: 5e-8, ..OUTDOOR.loss },
    rates: RateOptions { vertices: 0.0025, ..OUTDOOR.rates },
    refine: RefineOptions { prune_weight: 0.0256, ..OUTDOOR.refine },
    ..OUTDOOR
};

const SOLID: TrainOptions = TrainOptions {
    preset: TrainPreset::Solid,
    steps: 8000,
    max_triangles: 150_000,
    sh_degree: 0,
    loss: LossOptions { dssim: 0.05, ..OUTDOOR.loss },
    refine: RefineOptions { until: 29_000.0, relocate: 0.03, ..OUTDOOR.refine },
    solid: SolidifyOptions {
        enabled: true,
        opacity_from: 6000.0,
        opacity_until: 20_000.0,
        prune_opacity: 0.05,
        prune_faint: [PruneFaint { from_step: 19_400.0, min_opacity: 0.4 }, PruneFaint::NEVER],
        sigma_until: 20_000.0,
        engine_shading_from: 20_000.0,
        opaque_from: 20_000.0,
        vertices_rate_scale: 2.0,
        ..OUTDOOR.solid
    },
    ..OUTDOOR
};

/// `train_game_engine.py` of the paper's code on our soft training: from 25,000 of 30,000 steps on, losses drive σ
/// down and opacity up, and what stays faint or soft is deleted.
const PAPER_ENGINE: TrainOptions = TrainOptions {
    preset: TrainPreset::PaperEngine,
    sh_degree: 0,
    init: InitOptions { shell_subdivisions: 0, ..OUTDOOR.init },
    loss: LossOptions { normal: 0.0001, ..OUTDOOR.loss },
    solid: SolidifyOptions {
        enabled: true,
        opacity_from: 25_000.0,
        opacity_until: 30_000.0,
        opacity_gain: 1.0,
        prune_opacity: 0.014,
        prune_faint: [
            PruneFaint { from_step: 25_000.0, min_opacity: 0.1 },
            PruneFaint { from_step: 29_000.0, min_opacity: 0.7 },
        ],
        loss_sigma: 1.0,
        loss_opacity: 20.0,
        rate_sigma: 0.0008,
        prune_soft: PruneSoft { from_step: 28_000.0, max_sigma: 1.0 },
        sigma_from: 30_000.0,
        sigma_until: 30_000.0,
        sigma_scale: 1.0,
        prune_weight: 0.022,
        engine_shading_from: 30_000.0,
        opaque_from: 30_000.0,
        linear_blending: false,
        ..OUTDOOR.solid
    },
    ..OUTDOOR
};
