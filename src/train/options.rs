//! Every number of the training, declared once: the library's struct, the flags and the config file.
//!
//! Positions in the run ("steps of a 30,000-step run") are scaled by `steps / 30,000`, so that a short
//! preview and a long run follow one schedule. Lengths are in units of the scene: the median distance
//! from the cameras to what they see. Numbers in brackets are those of the paper, its supplement and its code (TS),
//! or of Triangle Splatting+ (TS+): see [`train`](mod@crate::train). Where the default is another,
//! `docs/benchmarks/training.md` has the runs that chose it.

use crate::error::{Error, Result};
use crate::raster::soft::{SoftOptions, Sort, Window};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The run all schedule positions are written for (Held et al. 2025, supplement).
pub const REFERENCE_STEPS: f64 = 30_000.0;

/// Depths between which the distortion is taken, scene units (TS 0.2 and 100, in units about four times
/// smaller).
const DEPTH_RANGE: [f32; 2] = [0.05, 25.0];

/// No number of a training makes sense above this.
const LARGEST: f64 = 1e9;
/// Points drawn at random at most: as many as a scene may have triangles.
const MOST_POINTS: u64 = 1 << 26;

/// A complete set of options for a kind of scene.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum TrainPreset {
    /// Opaque triangles of one colour each, as a game engine draws them.
    #[default]
    Solid,
    /// Soft, as in the paper, for research: open scenes with a far background.
    Outdoor,
    /// Soft, as in the paper, for research: rooms, with more SSIM and flatter surfaces.
    Indoor,
    /// The paper's own way to opaque triangles, for comparison.
    PaperEngine,
}

/// How a soup is trained.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(default, deny_unknown_fields)]
#[cfg_attr(feature = "cli", command(next_help_heading = "Training"))]
pub struct TrainOptions {
    /// Start from the numbers of this kind of scene.
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t))]
    pub preset: TrainPreset,
    /// Steps, one photo each; every schedule stretches with it.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = TrainOptions::default().steps))]
    pub steps: u64,
    /// The scene never holds more triangles than this.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = TrainOptions::default().max_triangles))]
    pub max_triangles: u64,
    /// Highest degree of the view-dependent colour, 0 to 3; it is reached one degree at a time.
    #[cfg_attr(feature = "cli", arg(long, value_name = "D", default_value_t = TrainOptions::default().sh_degree, value_parser = clap::value_parser!(u8).range(0..=3)))]
    pub sh_degree: u8,
    /// Seed of every random choice; the same seed gives the same bits on any number of threads.
    #[cfg_attr(feature = "cli", arg(long, value_name = "N", default_value_t = 0))]
    pub seed: u64,
    /// Steps after which 12,000, 20,000, 24,000 and 27,000 of a 30,000-step run are done; zeros: in proportion. Runs with a
    /// budget choose them.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub milestones: [u64; 4],
    /// How the scene is drawn.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub draw: TrainDrawOptions,
    /// What the first triangles look like.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub init: InitOptions,
    /// What is minimised.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub loss: LossOptions,
    /// The learning rates of each group of parameters.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub rates: RateOptions,
    /// How triangles are added and removed.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub refine: RefineOptions,
    /// How early steps save time on smaller photos.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub warmup: WarmupOptions,
    /// How the scene becomes solid in the last part of the run.
    #[cfg_attr(feature = "cli", arg(skip))]
    pub solid: SolidifyOptions,
}

/// How the scene is drawn.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrainDrawOptions {
    /// Blend the layers of a pixel by their depth there, not by their centres': exact, and slower.
    pub sort_per_pixel: bool,
    /// Pass gradients through the incenter's distance φ(s); TS holds it constant.
    pub exact_incenter: bool,
    /// The window is a sigmoid of the distance from the edges, as in earlier work; for the ablation of the paper's
    /// window, which is bounded by the edges.
    pub sigmoid_window: bool,
    /// Depth at which triangles are cut, scene units (TS 0.2, in COLMAP's arbitrary units).
    pub near: f64,
    /// Inradius from which a triangle has its full opacity, px; smaller ones fade (TS drops those below 1).
    pub fade_px: f64,
}

/// What the first triangles look like.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct InitOptions {
    /// k: corners lie on a sphere of k times the mean distance to the three nearest points (2.2, supplement).
    pub size: f64,
    /// First σ (1.16, supplement).
    pub sigma: f64,
    /// First opacity (0.28, supplement).
    pub opacity: f64,
    /// Triangles of the sky dome, as a share of the points; 0 for none (TS 0.05, not in the paper).
    pub dome_share: f64,
    /// Radius of the dome, in distances from the centre to the farthest point of the inner 99% (TS 1).
    pub dome_radius: f64,
    /// Subdivisions of the shell that closes the scene where it has no points: 8 · 4^n triangles at most, 0 for none
    /// (not in the paper). Small runs have fewer, photos with masks none.
    pub shell_subdivisions: u32,
    /// Points drawn at random inside the cameras' views when the data set has none.
    pub random_points: u64,
}

/// What is minimised (Held et al. 2025, eq. 3).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LossOptions {
    /// λ: weight of 1 - SSIM against L1 (TS 0.2 outdoor, 0.4 indoor).
    pub dssim: f64,
    /// β1: weight of the mean opacity (0.0055, supplement).
    pub opacity: f64,
    /// β2: weight of the distortion (TS 0 outdoor, 1 indoor).
    pub distortion: f64,
    /// β3: weight of the normal consistency (0.0001 outdoor, 0.00004 indoor, supplement).
    pub normal: f64,
    /// β4: weight of 1 / mean area, in squared scene units (1e-8 outdoor, 5e-8 indoor, supplement).
    pub size: f64,
    /// Distortion and normals count from here on, steps of a 30,000-step run (TS 5000).
    pub geometry_from: f64,
    /// Size counts up to here, steps of a 30,000-step run (TS 25,000).
    pub size_until: f64,
}

/// The learning rates of each group of parameters.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RateOptions {
    /// First rate of the corners, scene units (0.0018 outdoor, 0.0015 indoor, in COLMAP's arbitrary units).
    pub vertices: f64,
    /// Last rate of the corners as a share of the first, reached log-linearly (TS 0.01).
    pub vertices_final_share: f64,
    /// Rate of the opacity's logit (0.014, supplement).
    pub opacity: f64,
    /// Rate of the logarithm of σ (0.0008, supplement).
    pub sigma: f64,
    /// Rate of the colour (0.0025, supplement).
    pub sh: f64,
    /// Rate of the view-dependent colour as a share of `sh` (TS 1/20).
    pub sh_rest: f64,
    /// Last rate of opacity, σ and colour as a share of the first (TS 1).
    pub final_share: f64,
    /// Skip triangles the step's photo gives no gradient, moments included (3DGS's sparse Adam).
    pub sparse: bool,
    /// Steps between degrees of the view-dependent colour, of a 30,000-step run (TS 1000).
    pub sh_every: f64,
}

/// By what weight the triangles that grow are sampled (Held et al. 2025, section 3.2).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum SampleWeight {
    /// By opacity and by 1/σ, alternately.
    #[default]
    Alternating,
    /// Always by opacity.
    Opacity,
    /// Always by 1/σ.
    Sigma,
    /// Every triangle has the same chance (not in the paper).
    Uniform,
    /// By the squared error of the pixels that show it (not in the paper).
    Error,
}

/// How triangles are added and removed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct RefineOptions {
    /// First refinement, steps of a 30,000-step run (500, supplement).
    pub from: f64,
    /// No triangle is added after this, steps of a 30,000-step run (25,000, supplement).
    pub until: f64,
    /// Steps between refinements, of a 30,000-step run (500, supplement).
    pub every: f64,
    /// Triangles added at a refinement, as a share of those there (0.3, supplement).
    pub growth: f64,
    /// What a triangle's chance to grow is in proportion to.
    pub sample_by: SampleWeight,
    /// Share of the triangles that make room at each refinement from `engine_shading_from` on, in a scene that has all it may
    /// have: those of the least blending weight, summed over all photos (not in the paper; parts of a scene keep theirs).
    pub relocate: f64,
    /// τ_small: larger triangles are split into four, smaller ones cloned; distance of the farthest corner
    /// from the centre, px of the full photo (24, supplement: split_size).
    pub split_px: f64,
    /// Largest shift of a clone, in halves of the triangle's box (1.5, supplement: max_noise_factor).
    pub clone_shift: f64,
    /// τ_prune: triangles that reach this blending weight at no pixel are pruned (0.022 outdoor, 0.0256 indoor, supplement).
    pub prune_weight: f64,
    /// Triangles fainter than this are pruned (0.014, supplement: opacity_dead).
    pub prune_opacity: f64,
    /// Triangles visible in fewer photos than this are pruned (2, Held et al. 2025, section 3.2).
    pub min_views: u32,
}

/// How early steps save time on smaller photos (not in the paper).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WarmupOptions {
    /// Photos at a quarter of their size up to here, steps of a 30,000-step run.
    pub quarter_until: f64,
    /// Photos at half their size up to here, steps of a 30,000-step run.
    pub half_until: f64,
    /// The smaller photos are not made smaller than this on the shorter side, px.
    pub min_px: u32,
}

/// How the scene becomes solid in the last part of the run (supplement: the final 5,000 of 30,000 steps).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SolidifyOptions {
    /// Whether it becomes solid at all.
    pub enabled: bool,
    /// The opacity's anneal starts, steps of a 30,000-step run (TS+ 5000).
    pub opacity_from: f64,
    /// The opacity's anneal ends, steps of a 30,000-step run (TS+ 24,000).
    pub opacity_until: f64,
    /// The opacity no triangle is below at the end of its anneal, reached linearly (TS+ 0.9999).
    pub opacity_floor: f64,
    /// How many times steeper the opacity's sigmoid has become at the end of its anneal, log-linearly: it drives
    /// each opacity to 0 or 1, whichever lowers the loss.
    pub opacity_gain: f64,
    /// Triangles fainter than this are pruned at the end of the opacity's anneal, reached linearly (TS 0.7).
    pub prune_opacity: f64,
    /// Prunes faint triangles (TS: below 0.1 from 25,000 on and below 0.7 from 29,000 on).
    pub prune_faint: [PruneFaint; 2],
    /// Weight of the mean σ in the loss from `opacity_from` on (TS 1).
    pub loss_sigma: f64,
    /// Weight of 1 / mean opacity in the loss from `opacity_from` on (TS 20).
    pub loss_opacity: f64,
    /// Weight of half the squared error beside L1 from `engine_shading_from` on (not in the paper).
    pub loss_square: f64,
    /// Rate of the logarithm of σ from `opacity_from` on, for a 30,000-step run; shorter ones get a higher rate, so that σ changes as much (TS
    /// 0.0008); 0 keeps `rates.sigma`.
    pub rate_sigma: f64,
    /// Prunes soft triangles (TS: of σ 1 and more from 28,000 on).
    pub prune_soft: PruneSoft,
    /// σ starts to fall, steps of a 30,000-step run (TS+ 0).
    pub sigma_from: f64,
    /// σ has fallen, steps of a 30,000-step run (TS+ 30,000).
    pub sigma_until: f64,
    /// What σ has been multiplied by then, reached log-linearly (TS+ 0.0001, linearly).
    pub sigma_scale: f64,
    /// τ_prune at the end of the opacity's anneal, reached linearly (TS+ 0.235).
    pub prune_weight: f64,
    /// From here on the scene is drawn as an engine draws it, but for the opacity: in the order of the depths
    /// at each pixel, with antialiased edges and one colour per triangle; steps of a 30,000-step run.
    pub engine_shading_from: f64,
    /// Every triangle is opaque from here on, steps of a 30,000-step run.
    pub opaque_from: f64,
    /// Samples per pixel along each axis from `engine_shading_from` on (TS+ 4).
    pub samples_per_axis: u32,
    /// Width of an edge's antialiasing ramp from `engine_shading_from` on, samples.
    pub edge_width_samples: f64,
    /// Mix the colours of a pixel's triangles in linear light from `engine_shading_from` on, as engines do.
    pub linear_blending: bool,
    /// Rate of the corners at `engine_shading_from`, as a share of what it was just before.
    pub vertices_rate_scale: f64,
    /// Last rate of the corners as a share of that at `engine_shading_from`, reached log-linearly.
    pub vertices_final_share: f64,
}

/// Prunes triangles that are too faint, from some step on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PruneFaint {
    /// From here on, steps of a 30,000-step run.
    pub from_step: f64,
    /// Fainter triangles are pruned.
    pub min_opacity: f64,
}

impl PruneFaint {
    /// Prunes nothing.
    pub const NEVER: Self = Self { from_step: REFERENCE_STEPS, min_opacity: 0.0 };
}

impl Default for PruneFaint {
    fn default() -> Self {
        Self::NEVER
    }
}

/// Prunes triangles that are too soft, from some step on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PruneSoft {
    /// From here on, steps of a 30,000-step run.
    pub from_step: f64,
    /// Triangles of this σ and more are pruned.
    pub max_sigma: f64,
}

impl PruneSoft {
    /// Prunes nothing.
    pub const NEVER: Self = Self { from_step: REFERENCE_STEPS, max_sigma: 1000.0 };
}

impl Default for PruneSoft {
    fn default() -> Self {
        Self::NEVER
    }
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
    RefineOptions.refine,
    WarmupOptions.warmup,
    SolidifyOptions.solid
);

impl TrainOptions {
    /// How the rasteriser draws the scene over `background`.
    pub fn drawing(&self, background: [f32; 3]) -> SoftOptions {
        SoftOptions {
            window: if self.draw.sigmoid_window { Window::Sigmoid } else { Window::Soft },
            background,
            sort: if self.draw.sort_per_pixel { Sort::Pixel } else { Sort::Tile },
            exact_incenter: self.draw.exact_incenter,
            near: self.draw.near as f32,
            fade_px: self.draw.fade_px as f32,
            depth_range: DEPTH_RANGE,
            ..SoftOptions::default()
        }
    }

    /// Checks every number against the range it makes sense in.
    pub fn validate(&self) -> Result<()> {
        let wants = |ok: bool, option: &str, value: f64, wants: &str| match ok {
            true => Ok(()),
            false => Err(Error::invalid(option, value, wants)),
        };
        // NaN is in no range.
        let most = |option, value: f64, most: f64, range: &str| {
            wants(value > 0.0 && value <= most, option, value, range)
        };
        let positive = |option, value: f64| most(option, value, LARGEST, "> 0, at most 1e9");
        let at_least_zero = |option, value: f64| {
            wants((0.0..=LARGEST).contains(&value), option, value, "0 or more, at most 1e9")
        };
        let share = |option, value: f64| wants((0.0..=1.0).contains(&value), option, value, "0 to 1");
        wants(self.steps >= 1, "steps", self.steps as f64, "1 or more")?;
        wants(self.max_triangles >= 1, "max_triangles", self.max_triangles as f64, "1 or more")?;
        wants(self.sh_degree <= 3, "sh_degree", f64::from(self.sh_degree), "0, 1, 2 or 3")?;
        let milestones = &self.milestones;
        let rising = milestones.is_sorted() && milestones[3] <= self.steps;
        if *milestones != [0; 4] && !(rising && milestones[0] > 0) {
            let wants = "four steps of the run that do not fall, the first above 0, or [0, 0, 0, 0]";
            return Err(Error::invalid("milestones", format!("{milestones:?}"), wants));
        }
        positive("draw.near", self.draw.near)?;
        let faint = &self.solid.prune_faint;
        // Outside its edges a triangle has no depth and no normal to take a gradient of.
        let geometry = self.loss.normal + self.loss.distortion;
        let ok = !self.draw.sigmoid_window || geometry == 0.0;
        wants(ok, "draw.sigmoid_window", 1.0, "loss.normal and loss.distortion of 0")?;
        at_least_zero("draw.fade_px", self.draw.fade_px)?;
        most("init.size", self.init.size, 1000.0, "> 0, at most 1000")?;
        positive("init.sigma", self.init.sigma)?;
        wants(
            self.init.opacity > 0.0 && self.init.opacity < 1.0,
            "init.opacity",
            self.init.opacity,
            "0 to 1",
        )?;
        let dome = self.init.dome_share;
        wants((0.0..=10.0).contains(&dome), "init.dome_share", dome, "0 to 10")?;
        most("init.dome_radius", self.init.dome_radius, 1e6, "> 0, at most 1e6")?;
        let shell = self.init.shell_subdivisions;
        wants(shell <= 6, "init.shell_subdivisions", shell.into(), "0 to 6")?;
        let random = self.init.random_points;
        wants((1..=MOST_POINTS).contains(&random), "init.random_points", random as f64, "1 to 67108864")?;
        share("loss.dssim", self.loss.dssim)?;
        for (option, value) in self.non_negative() {
            at_least_zero(option, value)?;
        }
        positive("rates.vertices_final_share", self.rates.vertices_final_share)?;
        positive("rates.final_share", self.rates.final_share)?;
        positive("refine.every", self.refine.every)?;
        share("refine.relocate", self.refine.relocate)?;
        share("refine.prune_weight", self.refine.prune_weight)?;
        share("refine.prune_opacity", self.refine.prune_opacity)?;
        positive("solid.sigma_scale", self.solid.sigma_scale)?;
        wants(self.solid.opacity_gain >= 1.0, "solid.opacity_gain", self.solid.opacity_gain, "1 or more")?;
        share("solid.prune_opacity", self.solid.prune_opacity)?;
        share("solid.prune_faint", faint[0].min_opacity)?;
        share("solid.prune_faint", faint[1].min_opacity)?;
        positive("solid.vertices_final_share", self.solid.vertices_final_share)?;
        positive("solid.edge_width_samples", self.solid.edge_width_samples)?;
        let samples = self.solid.samples_per_axis;
        wants((1..=8).contains(&samples), "solid.samples_per_axis", samples.into(), "1 to 8")?;
        share("solid.opacity_floor", self.solid.opacity_floor)?;
        share("solid.prune_weight", self.solid.prune_weight)
    }

    /// The numbers that may be anything from 0 on, by their keys.
    fn non_negative(&self) -> [(&'static str, f64); 32] {
        let (faint, soft) = (&self.solid.prune_faint, &self.solid.prune_soft);
        [
            ("loss.opacity", self.loss.opacity),
            ("loss.distortion", self.loss.distortion),
            ("loss.normal", self.loss.normal),
            ("loss.size", self.loss.size),
            ("loss.geometry_from", self.loss.geometry_from),
            ("loss.size_until", self.loss.size_until),
            ("rates.vertices", self.rates.vertices),
            ("rates.opacity", self.rates.opacity),
            ("rates.sigma", self.rates.sigma),
            ("rates.sh", self.rates.sh),
            ("rates.sh_rest", self.rates.sh_rest),
            ("rates.sh_every", self.rates.sh_every),
            ("refine.from", self.refine.from),
            ("refine.until", self.refine.until),
            ("refine.growth", self.refine.growth),
            ("refine.split_px", self.refine.split_px),
            ("refine.clone_shift", self.refine.clone_shift),
            ("warmup.quarter_until", self.warmup.quarter_until),
            ("warmup.half_until", self.warmup.half_until),
            ("solid.opacity_from", self.solid.opacity_from),
            ("solid.opacity_until", self.solid.opacity_until),
            ("solid.sigma_from", self.solid.sigma_from),
            ("solid.sigma_until", self.solid.sigma_until),
            ("solid.engine_shading_from", self.solid.engine_shading_from),
            ("solid.opaque_from", self.solid.opaque_from),
            ("solid.vertices_rate_scale", self.solid.vertices_rate_scale),
            ("solid.prune_faint", faint[0].from_step.min(faint[1].from_step)),
            ("solid.loss_sigma", self.solid.loss_sigma),
            ("solid.loss_opacity", self.solid.loss_opacity),
            ("solid.loss_square", self.solid.loss_square),
            ("solid.rate_sigma", self.solid.rate_sigma),
            ("solid.prune_soft", soft.from_step.min(soft.max_sigma)),
        ]
    }
}
