//! The presets: complete literals, one a kind of scene.

use super::options::{
    InitOptions, LossOptions, Preset, RateOptions, RefineOptions, SolidOptions, TrainOptions, WarmupOptions,
};

impl TrainOptions {
    /// The options of a preset.
    pub const fn preset(preset: Preset) -> Self {
        match preset {
            Preset::Outdoor => OUTDOOR,
            Preset::Indoor => INDOOR,
            Preset::Solid => SOLID,
        }
    }
}

const OUTDOOR: TrainOptions = TrainOptions {
    preset: Preset::Outdoor,
    steps: 3000,
    max_triangles: 60_000,
    sh_degree: 3,
    seed: 0,
    init: InitOptions {
        size: 2.2,
        sigma: 1.16,
        opacity: 0.28,
        dome: 0.0,
        dome_radius: 1.0,
        random_points: 10_000,
    },
    loss: LossOptions {
        dssim: 0.2,
        opacity: 0.0055,
        distortion: 0.0,
        normal: 0.0001,
        size: 1e-8,
        geometry_from: 5000.0,
        size_until: 25_000.0,
    },
    rates: RateOptions {
        vertices: 0.0015,
        vertices_final: 0.01,
        opacity: 0.014,
        sigma: 0.0008,
        sh: 0.0025,
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
        split_px: 24.0,
        noise: 1.5,
        prune_weight: 0.022,
        prune_opacity: 0.014,
        min_views: 2,
    },
    warmup: WarmupOptions { quarter_until: 3000.0, half_until: 10_000.0, min_px: 32 },
    solid: SolidOptions {
        enabled: false,
        from: 25_000.0,
        until: 29_000.0,
        sigma_scale: 0.01,
        opacity: 0.9999,
        prune_weight: 0.235,
    },
};

const INDOOR: TrainOptions = TrainOptions {
    preset: Preset::Indoor,
    steps: 3000,
    max_triangles: 60_000,
    sh_degree: 3,
    seed: 0,
    init: InitOptions {
        size: 2.2,
        sigma: 1.16,
        opacity: 0.28,
        dome: 0.0,
        dome_radius: 1.0,
        random_points: 10_000,
    },
    loss: LossOptions {
        dssim: 0.4,
        opacity: 0.0055,
        distortion: 1.0,
        normal: 0.00004,
        size: 5e-8,
        geometry_from: 5000.0,
        size_until: 25_000.0,
    },
    rates: RateOptions {
        vertices: 0.00125,
        vertices_final: 0.01,
        opacity: 0.014,
        sigma: 0.0008,
        sh: 0.0025,
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
        split_px: 24.0,
        noise: 1.5,
        prune_weight: 0.0256,
        prune_opacity: 0.014,
        min_views: 2,
    },
    warmup: WarmupOptions { quarter_until: 3000.0, half_until: 10_000.0, min_px: 32 },
    solid: SolidOptions {
        enabled: false,
        from: 25_000.0,
        until: 29_000.0,
        sigma_scale: 0.01,
        opacity: 0.9999,
        prune_weight: 0.235,
    },
};

const SOLID: TrainOptions = TrainOptions {
    preset: Preset::Solid,
    steps: 3000,
    max_triangles: 60_000,
    sh_degree: 0,
    seed: 0,
    init: InitOptions {
        size: 2.2,
        sigma: 1.16,
        opacity: 0.28,
        dome: 0.0,
        dome_radius: 1.0,
        random_points: 10_000,
    },
    loss: LossOptions {
        dssim: 0.2,
        opacity: 0.0055,
        distortion: 0.0,
        normal: 0.0001,
        size: 1e-8,
        geometry_from: 5000.0,
        size_until: 25_000.0,
    },
    rates: RateOptions {
        vertices: 0.0015,
        vertices_final: 0.01,
        opacity: 0.014,
        sigma: 0.0008,
        sh: 0.0025,
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
        split_px: 24.0,
        noise: 1.5,
        prune_weight: 0.022,
        prune_opacity: 0.014,
        min_views: 2,
    },
    warmup: WarmupOptions { quarter_until: 3000.0, half_until: 10_000.0, min_px: 32 },
    solid: SolidOptions {
        enabled: true,
        from: 25_000.0,
        until: 29_000.0,
        sigma_scale: 0.01,
        opacity: 0.9999,
        prune_weight: 0.235,
    },
};
