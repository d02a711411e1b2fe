//! The presets, one per kind of scene: outdoor in full, the others as differences from it.

use super::options::{
    DensifyOptions, InitOptions, LossOptions, RateOptions, SampleWeight, SolidifyOptions, TrainDrawOptions,
    TrainOptions, TrainPreset, WarmupOptions,
};
use trisplat_dataset::exposure::ExposureUse;

impl TrainOptions {
    /// The options of a preset.
    pub const fn preset(preset: TrainPreset) -> Self {
        match preset {
            TrainPreset::Outdoor => OUTDOOR,
            TrainPreset::Indoor => INDOOR,
            TrainPreset::Solid => SOLID,
        }
    }
}

impl TrainOptions {
    /// The options of a preset for a run that starts from a trained scene instead of points: no small photos
    /// first, all degrees of view-dependent colour from the first steps on, corners that move less, and the
    /// anneal from the first step on.
    pub fn from_scene(preset: TrainPreset) -> Self {
        let base = Self::preset(preset);
        let rates = RateOptions { corners: 0.3 * base.rates.corners, ..base.rates };
        let warmup = WarmupOptions { quarter_until: 0.0, half_until: 0.0 };
        match preset {
            TrainPreset::Solid => Self {
                steps: 4000,
                sh_degree: 3,
                rates,
                warmup,
                solid: SolidifyOptions { opacity_from: 0.0, opacity_until: HARDENED },
                ..base
            },
            _ => Self { rates, warmup, ..base },
        }
    }
}

/// The position where a soft scene has become opaque, steps of a 30,000-step run.
const HARDENED: f64 = 12_000.0;

const OUTDOOR: TrainOptions = TrainOptions {
    preset: TrainPreset::Outdoor,
    steps: 5000,
    max_triangles: 60_000,
    sh_degree: 3,
    seed: 0,
    exposure: ExposureUse::Auto,
    milestones: [0; 4],
    draw: TrainDrawOptions { sort_per_pixel: false },
    init: InitOptions { size: 2.2, shell_subdivisions: 4 },
    loss: LossOptions { dssim: 0.2, opacity: 0.0055, distortion: 0.0, normal: 0.0, size: 1e-8 },
    rates: RateOptions { corners: 0.075, sparse: true },
    densify: DensifyOptions {
        until: 25_000.0,
        every: 500.0,
        growth: 0.3,
        sample_by: SampleWeight::Alternating,
        relocate: 0.0,
        split_px: 12.0,
        prune_weight: 0.022,
    },
    warmup: WarmupOptions { quarter_until: 12_000.0, half_until: 24_000.0 },
    solid: SolidifyOptions { opacity_from: 5000.0, opacity_until: 24_000.0 },
};

const INDOOR: TrainOptions = TrainOptions {
    preset: TrainPreset::Indoor,
    loss: LossOptions { dssim: 0.4, distortion: 1.0, normal: 0.00004, size: 5e-8, ..OUTDOOR.loss },
    rates: RateOptions { corners: 0.0625, ..OUTDOOR.rates },
    densify: DensifyOptions { prune_weight: 0.0256, ..OUTDOOR.densify },
    ..OUTDOOR
};

const SOLID: TrainOptions = TrainOptions {
    preset: TrainPreset::Solid,
    steps: 8000,
    max_triangles: 150_000,
    sh_degree: 0,
    loss: LossOptions { dssim: 0.05, ..OUTDOOR.loss },
    densify: DensifyOptions { until: 29_000.0, relocate: 0.03, ..OUTDOOR.densify },
    solid: SolidifyOptions { opacity_from: 6000.0, opacity_until: 20_000.0 },
    ..OUTDOOR
};
