//! Every number of the training, declared once: the library's struct, the flags and the config
//! file.
//!
//! Positions in the run ("steps of a 30,000-step run") are scaled by `steps / 30,000`, so that a
//! short preview and a long run follow one schedule. Lengths are in units of the scene: the median
//! distance from the cameras to visible points. Numbers in brackets are those of the paper, its
//! supplement and its code (TS), or of Triangle Splatting+ (TS+): see [`train`](mod@crate). Where
//! the default is another, `docs/benchmarks/history.md` has the runs that chose it.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::exposure::ExposureUse;
use trisplat_raster::soft::{SoftOptions, Sort, Window};
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::{Error, Result};

/// The run all schedule positions are written for (Held et al. 2025, supplement).
pub const REFERENCE_STEPS: f64 = 30_000.0;

/// Depth range of the distortion, scene units (TS 0.2 and 100, in units about four times smaller).
const DEPTH_RANGE: [f32; 2] = [0.05, 25.0];

/// Depth at which triangles are clipped, scene units (TS 0.2, in COLMAP's arbitrary units).
const NEAR: f32 = 0.01;

/// Inradius from which a triangle has its full opacity, px; smaller ones fade (TS drops those below
/// 1).
const FADE_PX: f32 = 0.5;

/// A complete set of options for a kind of scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum TrainPreset {
    /// Opaque triangles of one colour each, as a game engine draws them.
    #[default]
    Solid,
    /// Soft triangles, as in the paper, for research: open scenes with a far background; `outdoor`
    /// is its old name.
    #[serde(rename = "soft-outdoor", alias = "outdoor")]
    #[cfg_attr(feature = "cli", value(name = "soft-outdoor", alias = "outdoor"))]
    Outdoor,
    /// Soft triangles, as in the paper, for research: rooms, with more SSIM and flatter surfaces;
    /// `indoor` is its old name.
    #[serde(rename = "soft-indoor", alias = "indoor")]
    #[cfg_attr(feature = "cli", value(name = "soft-indoor", alias = "indoor"))]
    Indoor,
}

/// Options of a training.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", command(next_help_heading = "Training"))]
pub struct TrainOptions {
    /// The kind of result: opaque triangles for engines, or soft ones.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub preset: TrainPreset,
    /// Number of steps, one photo each; every schedule stretches with it. Soft presets have 5000.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = TrainOptions::default().steps))]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub steps: u64,
    /// Maximum number of triangles of the scene. Soft presets have 60,000.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = TrainOptions::default().max_triangles))]
    #[schemars(range(min = 1, max = 1_000_000_000))]
    pub max_triangles: u64,
    /// Highest degree of the view-dependent colour, 0 to 3; it is reached one degree at a time. Soft
    /// presets have 3. Opaque scenes of more than 0 are for `bake --sh`: they shine better, and may
    /// look worse in viewers without it.
    #[cfg_attr(feature = "cli", arg(long, value_name = "D", default_value_t = TrainOptions::default().sh_degree, value_parser = clap::value_parser!(u8).range(0..=3)))]
    #[schemars(range(max = 3))]
    pub sh_degree: u8,
    /// Seed of every random choice; the same seed gives the same bits on any number of threads.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 0))]
    pub seed: u64,
    /// Correction of photos that differ in exposure and white balance, or are darker in their
    /// corners.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub exposure: ExposureUse,
    /// Steps after which 12,000, 20,000, 24,000 and 27,000 of a 30,000-step run are done; zeros: in
    /// proportion. Runs with a budget choose them.
    #[cfg_attr(feature = "cli", arg(skip))]
    #[schemars(inner(range(max = 1_000_000_000)))]
    pub milestones: [u64; 4],
    /// Drawing of the scene.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub draw: TrainDrawOptions,
    /// The size of the first triangles, and the shell.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub init: InitOptions,
    /// The loss that is minimised.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub loss: LossOptions,
    /// The learning rates of each group of parameters.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub rates: RateOptions,
    /// Adding and removing triangles.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub densify: DensifyOptions,
    /// Early steps on smaller photos, which save time.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub warmup: WarmupOptions,
    /// The anneal to a solid scene in the last part of the run.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub solid: SolidifyOptions,
}

/// Drawing of the scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrainDrawOptions {
    /// Blend the layers of a pixel by their depth there, not by their centres': exact, and slower.
    pub sort_per_pixel: bool,
}

/// The size of the first triangles, and the shell.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct InitOptions {
    /// k: corners lie on a sphere of k times the mean distance to the three nearest points (2.2,
    /// supplement).
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 1000.0))]
    pub size: f64,
    /// Subdivisions of the shell that closes the scene where it has no points: 8 · 4^n triangles at
    /// most, 0 for none (not in the paper). Small runs have fewer, photos with masks none.
    #[schemars(range(max = 6))]
    pub shell_subdivisions: u32,
}

/// The loss (Held et al. 2025, eq. 3).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LossOptions {
    /// λ: weight of 1 - SSIM against L1 (TS 0.2 outdoor, 0.4 indoor).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub dssim: f64,
    /// β1: weight of the mean opacity (0.0055, supplement).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub opacity: f64,
    /// β2: weight of the distortion (TS 0 outdoor, 1 indoor).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub distortion: f64,
    /// β3: weight of the normal consistency (0.0001 outdoor, 0.00004 indoor, supplement).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub normal: f64,
    /// β4: weight of 1 / mean area, in squared scene units (1e-8 outdoor, 5e-8 indoor, supplement).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub size: f64,
}

/// The learning rates of each group of parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RateOptions {
    /// First rate of the corners, as a share of their triangle's size, the root of its area (the
    /// supplement has 0.0018 outdoor, 0.0015 indoor, for triangles of all sizes, in COLMAP's
    /// arbitrary units).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub corners: f64,
    /// Skip triangles without a gradient in the step's photo, moments included (3DGS's sparse
    /// Adam).
    pub sparse: bool,
}

/// The weight for sampling triangles that grow (Held et al. 2025, section 3.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SampleWeight {
    /// By opacity and by 1/σ, alternately.
    #[default]
    Alternating,
    /// By the squared error of the pixels that show it (not in the paper).
    Error,
}

/// Adding and removing triangles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DensifyOptions {
    /// No triangle is added after this, steps of a 30,000-step run (25,000, supplement).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub until: f64,
    /// Steps between densifications, of a 30,000-step run (500, supplement).
    #[schemars(extend("exclusiveMinimum" = 0.0), range(max = 1e9))]
    pub every: f64,
    /// Triangles added at a densification, as a share of the present ones (0.3, supplement).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub growth: f64,
    /// The weight of a triangle's chance to grow.
    pub sample_by: SampleWeight,
    /// Share of the triangles removed at each densification from `opacity_until` on, in a scene at
    /// its limit, to make room: those of the least blending weight, summed over all photos (not in
    /// the paper; parts of a scene keep theirs).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub relocate: f64,
    /// τ_small: larger triangles are split into four, smaller ones cloned; distance of the farthest
    /// corner from the centre, px of the full photo (24, supplement: split_size).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub split_px: f64,
    /// τ_prune: triangles below this blending weight at every pixel are pruned (0.022 outdoor,
    /// 0.0256 indoor, supplement).
    #[schemars(range(min = 0.0, max = 1.0))]
    pub prune_weight: f64,
}

/// Early steps on smaller photos, which save time (not in the paper). Without a warm-up, as in runs
/// that start from a scene, the degree of view-dependent colour rises by one per step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WarmupOptions {
    /// Photos at a quarter of their size up to here, steps of a 30,000-step run.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub quarter_until: f64,
    /// Photos at half their size up to here, steps of a 30,000-step run.
    #[schemars(range(min = 0.0, max = 1e9))]
    pub half_until: f64,
}

/// The anneal to a solid scene in the last part of the run (supplement: the final 5,000 of 30,000
/// steps); presets that stay soft ignore it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SolidifyOptions {
    /// The opacity's anneal starts, steps of a 30,000-step run (TS+ 5000).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub opacity_from: f64,
    /// The anneal ends: from here on triangles are opaque, σ is small, and the scene has engine
    /// shading; steps of a 30,000-step run (TS+ 24,000).
    #[schemars(range(min = 0.0, max = 1e9))]
    pub opacity_until: f64,
    /// Highest degree of the view-dependent colour of opaque triangles: files show it after
    /// `bake --sh`. 0 in runs that start from a scene.
    #[schemars(range(max = 3))]
    pub sh_degree: u8,
}

impl Default for TrainOptions {
    fn default() -> Self {
        Self::preset(TrainPreset::default())
    }
}

macro_rules! default_of_default_preset {
    ($($options:ident . $field:ident),*) => {$(
        impl Default for $options {
            fn default() -> Self {
                TrainOptions::preset(TrainPreset::default()).$field
            }
        }
    )*};
}
default_of_default_preset!(
    TrainDrawOptions.draw,
    InitOptions.init,
    LossOptions.loss,
    RateOptions.rates,
    DensifyOptions.densify,
    WarmupOptions.warmup,
    SolidifyOptions.solid
);

impl TrainOptions {
    /// With this many steps.
    pub fn steps(self, steps: u64) -> Self {
        Self { steps, ..self }
    }

    /// With at most this many triangles.
    pub fn max_triangles(self, max_triangles: u64) -> Self {
        Self { max_triangles, ..self }
    }

    /// With this seed of random numbers.
    pub fn seed(self, seed: u64) -> Self {
        Self { seed, ..self }
    }

    /// True if the scene becomes solid.
    pub fn ends_solid(&self) -> bool {
        self.preset == TrainPreset::Solid
    }

    /// Drawing options of the rasteriser over `background`.
    pub fn drawing(&self, background: [f32; 3]) -> SoftOptions {
        SoftOptions {
            window: Window::Soft,
            background,
            sort: if self.draw.sort_per_pixel { Sort::Pixel } else { Sort::Tile },
            near: NEAR,
            fade_px: FADE_PX,
            depth_range: DEPTH_RANGE,
            ..SoftOptions::default()
        }
    }

    /// Checks the range of every number.
    pub fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Key)?;
        let milestones = &self.milestones;
        let rising = milestones.is_sorted() && milestones[3] <= self.steps;
        if *milestones != [0; 4] && !(rising && milestones[0] > 0) {
            let wants =
                "four steps of the run that do not fall, the first above 0, or [0, 0, 0, 0]";
            return Err(Error::invalid("milestones", format!("{milestones:?}"), wants));
        }
        Ok(())
    }

    /// The options of a preset.
    pub const fn preset(preset: TrainPreset) -> Self {
        match preset {
            TrainPreset::Outdoor => OUTDOOR,
            TrainPreset::Indoor => INDOOR,
            TrainPreset::Solid => SOLID,
        }
    }

    /// The options of a preset for a run that starts from a trained scene instead of points: no
    /// small photos first, all degrees of view-dependent colour from the first steps on, corners
    /// that move less, and the anneal from the first step on.
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
                solid: SolidifyOptions { opacity_from: 0.0, opacity_until: HARDENED, sh_degree: 0 },
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
    solid: SolidifyOptions { opacity_from: 5000.0, opacity_until: 24_000.0, sh_degree: 3 },
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
    solid: SolidifyOptions { opacity_from: 6000.0, opacity_until: 20_000.0, sh_degree: 3 },
    ..OUTDOOR
};

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::Value;

    /// Maximum number of options of a training, by their keys.
    const MAX_KEYS: usize = 30;

    fn keys(value: &Value) -> usize {
        value.as_object().map_or(1, |group| group.values().map(keys).sum())
    }

    #[test]
    fn a_training_has_few_keys() {
        let value = serde_json::to_value(TrainOptions::default()).unwrap();
        assert!(keys(&value) <= MAX_KEYS, "{} keys: {value:#}", keys(&value));
    }
}
