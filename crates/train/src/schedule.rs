//! The schedule of a run: rates, resolution, SH degree, regularisers, densifications and the anneal
//! at each step.

use super::options::{REFERENCE_STEPS, TrainOptions};
use super::params::Anneal;
use super::timeline::Timeline;
use trisplat_raster::soft::{SoftOptions, Sort, Window};

/// Largest alpha of a layer of the soft scene (3DGS).
pub(crate) const ALPHA_CAP: f32 = 0.99;

/// Largest alpha of a layer with engine shading, before the scene is opaque. Layers behind must
/// show a little, or the loss has no gradient towards removing a layer.
pub(crate) const ENGINE_ALPHA_CAP: f32 = 0.995;

/// Rate of the opacity's logit (0.014, supplement).
const OPACITY_RATE: f64 = 0.03;
/// Rate of the logarithm of σ (0.0008, supplement).
const SIGMA_RATE: f64 = 0.0008;
/// Rate of the colour (0.0025, supplement).
const SH_RATE: f64 = 0.008;
/// Last rate of the colours of opaque triangles as a share of the first, reached log-linearly: a
/// rate that stays lets colours follow the photo of the last steps.
const SH_FINAL_SHARE: f64 = 0.1;
/// Rate of the view-dependent colour as a share of that of the colour (TS 1/20).
const SH_REST_SHARE: f64 = 0.05;
/// Last rate of the corners as a share of the first, reached log-linearly (TS 0.01).
const CORNERS_FINAL_SHARE: f64 = 0.01;
/// Rate of the corners when engine shading begins, as a factor of the rate just before.
const ENGINE_CORNERS_SCALE: f64 = 8.0;
/// Last rate of the corners, as a factor of that, reached log-linearly.
const ENGINE_CORNERS_FINAL_SHARE: f64 = 0.1;
/// Steps between degrees of the view-dependent colour, of a 30,000-step run (TS 1000).
const SH_EVERY: f64 = 1000.0;
/// First step of the losses on distortion and normals, of a 30,000-step run (TS 5000).
const GEOMETRY_FROM: f64 = 5000.0;
/// Last step of the loss on size, of a 30,000-step run (TS 25,000).
const SIZE_UNTIL: f64 = 25_000.0;
/// Triangles fainter than this are pruned (0.014, supplement: opacity_dead).
const PRUNE_OPACITY: f64 = 0.014;
/// Steepness of the opacity's sigmoid at the end of the anneal, as a factor, reached log-linearly:
/// it drives each opacity to 0 or 1, whichever lowers the loss.
const SOLID_GAIN: f64 = 8.0;
/// Factor of σ at the end of the anneal, reached log-linearly from the first step on (TS+ 0.0001,
/// linearly).
const SOLID_SIGMA_SCALE: f64 = 0.02;
/// τ_prune at the end of the anneal, reached linearly (TS+ 0.235).
const SOLID_PRUNE_WEIGHT: f64 = 0.235;
/// Triangles fainter than this are pruned at the end of the anneal, reached linearly (TS 0.7).
const SOLID_PRUNE_OPACITY: f64 = 0.05;
/// Share of the anneal after which triangles fainter than the second number are pruned: so late
/// they are not on their way to 1, and as opaque ones they would be flecks.
const FAINTEST: (f64, f64) = (0.97, 0.4);
/// First densification, steps of a 30,000-step run (500, supplement).
pub(crate) const REFINE_FROM: f64 = 500.0;

/// Everything of one step that is not the scene or the photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepParams {
    /// Number of this step for Adam, from 1.
    pub time: u64,
    /// Rate of the corners, as a share of their triangle's size: the root of its area.
    pub corners: f64,
    /// Rate of the opacity's logit.
    pub opacity: f64,
    /// Rate of the logarithm of σ.
    pub sigma: f64,
    /// Rate of SH degree 0.
    pub sh: f64,
    /// Rate of the higher SH degrees.
    pub sh_rest: f64,
    /// SH degree in use.
    pub sh_degree: u8,
    /// λ: the weight of 1 - SSIM; L1 has the weight 1 - λ.
    pub dssim: f64,
    /// β1, of the mean opacity.
    pub beta_opacity: f64,
    /// β2, of the distortion.
    pub beta_distortion: f64,
    /// β3, of the normals.
    pub beta_normal: f64,
    /// β4, of 1 / mean area.
    pub beta_size: f64,
    /// Skip triangles without a gradient.
    pub sparse: bool,
    /// Largest alpha of a layer; it rises to 1 with the anneal, because solid triangles must not
    /// leak.
    pub alpha_cap: f32,
    /// State of the solid anneal.
    pub anneal: Anneal,
    /// Drawn as an engine draws: edges one pixel wide, colours mixed in linear light. One sample
    /// per pixel is enough: 2 by 2 gained 0.03 dB at 1.37 times the seconds.
    pub engine_shading: bool,
    /// Replaces the background of the run, sRGB-encoded: behind an object it changes from step to
    /// step.
    pub background: Option<[f32; 3]>,
}

impl StepParams {
    /// Drawing options of the rasteriser at this step.
    pub fn drawing(&self, options: &SoftOptions) -> SoftOptions {
        let background = self.background.unwrap_or(options.background);
        let soft = SoftOptions { alpha_cap: self.alpha_cap, background, ..*options };
        if self.engine_shading {
            SoftOptions {
                window: Window::Coverage { width_px: 1.0 },
                sort: Sort::Pixel,
                linear: true,
                ..soft
            }
        } else {
            soft
        }
    }
}

/// The plan of a run: a pure function of the step.
#[derive(Debug, Clone, Copy)]
pub struct Schedule<'a> {
    options: &'a TrainOptions,
    timeline: Timeline,
}

impl<'a> Schedule<'a> {
    /// The plan these options describe.
    pub fn new(options: &'a TrainOptions) -> Self {
        Self { options, timeline: Timeline::new(options) }
    }

    /// A position in a 30,000-step run as a step of this run.
    pub fn scaled(&self, position: f64) -> u64 {
        self.timeline.step_at(position)
    }

    /// Progress of the run after `step`.
    fn share(&self, step: u64) -> f64 {
        if self.timeline.has_milestones() {
            self.timeline.position(step) / REFERENCE_STEPS
        } else {
            step as f64 / self.options.steps.max(1) as f64
        }
    }

    /// Number of periods of `every`, in steps of a 30,000-step run, after `step` steps.
    fn passed(&self, step: u64, every: f64) -> u64 {
        if self.timeline.has_milestones() {
            (self.timeline.position(step) / every.max(1.0)).floor() as u64
        } else {
            step / self.scaled(every).max(1)
        }
    }

    /// The values for step `step` (from 0).
    pub fn rates(&self, step: u64) -> StepParams {
        let o = self.options;
        let l = &self.options.loss;
        let engine = self.is_opaque(step);
        let geometry = step >= self.scaled(GEOMETRY_FROM);
        let sh = SH_RATE * SH_FINAL_SHARE.powf(self.opaque_share(step).unwrap_or(0.0));
        StepParams {
            time: step + 1,
            corners: self.corners_rate(step),
            opacity: OPACITY_RATE,
            sigma: SIGMA_RATE,
            sh,
            sh_rest: sh * SH_REST_SHARE,
            sh_degree: self.sh_degree(step),
            dssim: l.dssim,
            beta_opacity: l.opacity,
            beta_distortion: if geometry { l.distortion } else { 0.0 },
            beta_normal: if geometry { l.normal } else { 0.0 },
            beta_size: if step < self.scaled(SIZE_UNTIL) { l.size } else { 0.0 },
            sparse: o.rates.sparse,
            alpha_cap: if engine { ENGINE_ALPHA_CAP } else { ALPHA_CAP }
                .max(self.anneal(step).opacity_floor),
            anneal: self.anneal(step),
            engine_shading: engine,
            background: None,
        }
    }

    /// Degree of the view-dependent colour: one more every thousand steps of a 30,000-step run;
    /// opaque triangles have a limit of their own.
    pub fn sh_degree(&self, step: u64) -> u8 {
        let o = self.options;
        // Without a warm-up, one more every step.
        let every = if o.warmup.half_until > 0.0 { SH_EVERY } else { 0.0 };
        let degree = u8::try_from(self.passed(step, every)).unwrap_or(u8::MAX).min(o.sh_degree);
        if self.is_opaque(step) { degree.min(o.solid.sh_degree) } else { degree }
    }

    /// Times the photo is halved at this step: 2, 1 or 0.
    pub fn level(&self, step: u64) -> u32 {
        let w = &self.options.warmup;
        if step < self.scaled(w.quarter_until) {
            2
        } else {
            u32::from(step < self.scaled(w.half_until))
        }
    }

    /// True once every triangle is opaque, with engine shading.
    pub fn is_opaque(&self, step: u64) -> bool {
        self.is_past(step, self.options.solid.opacity_until)
    }

    /// Progress from one position to another after `step`: 0 to 1, linearly.
    fn progress(&self, step: u64, [start, end]: [f64; 2]) -> f64 {
        if self.timeline.has_milestones() && self.options.ends_solid() {
            let length = (end - start).max(1.0);
            return ((self.timeline.position(step + 1) - start) / length).clamp(0.0, 1.0);
        }
        let from = self.scaled(start);
        let until = self.scaled(end).max(self.scaled(start) + 1);
        if !self.options.ends_solid() || step < from {
            return 0.0;
        }
        ((step - from + 1) as f64 / (until - from) as f64).min(1.0)
    }

    /// Progress of the opacity's anneal after `step`.
    fn annealed(&self, step: u64) -> f64 {
        self.progress(step, [self.options.solid.opacity_from, self.options.solid.opacity_until])
    }

    /// The state of the anneal at `step`: opacities move to 0 or 1 and σ falls, log-linearly.
    pub fn anneal(&self, step: u64) -> Anneal {
        if self.is_opaque(step) {
            return Anneal::SOLID;
        }
        let sigma = self.progress(step, [0.0, self.options.solid.opacity_until]);
        Anneal {
            opacity_floor: 0.0,
            opacity_gain: SOLID_GAIN.powf(self.annealed(step)) as f32,
            sigma_scale: SOLID_SIGMA_SCALE.powf(sigma) as f32,
        }
    }

    /// τ_prune after `step`. It rises with the anneal, because a soft scene has small weights,
    /// which the threshold of a solid one would delete at once.
    pub fn prune_weight(&self, step: u64) -> f64 {
        let soft = self.options.densify.prune_weight;
        soft + (SOLID_PRUNE_WEIGHT - soft) * self.annealed(step)
    }

    /// The opacity below which triangles are pruned after `step`; it rises with the anneal.
    pub fn prune_opacity(&self, step: u64) -> f64 {
        let (share, faintest) = FAINTEST;
        if self.is_past(step, share * self.options.solid.opacity_until) {
            faintest
        } else {
            PRUNE_OPACITY + (SOLID_PRUNE_OPACITY - PRUNE_OPACITY) * self.annealed(step)
        }
    }

    /// True when the scene becomes solid, and `step` is at or beyond a position.
    fn is_past(&self, step: u64, position: f64) -> bool {
        self.options.ends_solid() && step >= self.scaled(position)
    }

    /// Rate of the corners: log-linear over the run, and again from the beginning of engine
    /// shading.
    fn corners_rate(&self, step: u64) -> f64 {
        let o = self.options;
        let soft = |step: u64| o.rates.corners * CORNERS_FINAL_SHARE.powf(self.share(step));
        let Some(done) = self.opaque_share(step) else {
            return soft(step);
        };
        let from = self.scaled(o.solid.opacity_until);
        soft(from) * ENGINE_CORNERS_SCALE * ENGINE_CORNERS_FINAL_SHARE.powf(done)
    }

    /// Progress of the opaque part after `step`, 0 to 1; `None` before it.
    fn opaque_share(&self, step: u64) -> Option<f64> {
        if !self.is_opaque(step) {
            return None;
        }
        let from = self.scaled(self.options.solid.opacity_until);
        Some(if self.timeline.has_milestones() {
            (self.share(step) - self.share(from)) / (1.0 - self.share(from)).max(1e-6)
        } else {
            let steps = self.options.steps.max(1);
            (step - from) as f64 / steps.saturating_sub(from).max(1) as f64
        })
    }

    /// True when the scene is densified after `step` steps have been made.
    pub fn densifies_after(&self, step: u64) -> bool {
        let r = &self.options.densify;
        let due = if self.timeline.has_milestones() {
            step > 0 && self.passed(step, r.every) > self.passed(step - 1, r.every)
        } else {
            step.is_multiple_of(self.scaled(r.every).max(1))
        };
        due && step >= self.scaled(REFINE_FROM).max(1) && step < self.options.steps
    }

    /// True while a densification after `step` steps may add triangles.
    pub fn grows_after(&self, step: u64) -> bool {
        step < self.scaled(self.options.densify.until)
    }

    /// True while depth anchors move triangles after `step` steps: in the first half of the solid
    /// part. Later they cost more sharpness than they gain depth.
    pub fn pulls_after(&self, step: u64) -> bool {
        !self.is_past(step, (self.options.solid.opacity_until + REFERENCE_STEPS) / 2.0)
    }

    /// Number of the densification after `step` steps, counted over the whole run.
    pub fn densification(&self, step: u64) -> u64 {
        self.passed(step, self.options.densify.every)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::TrainPreset;

    #[test]
    fn positions_scale_with_the_run() {
        for steps in [300u64, 3000, 30_000] {
            let options = TrainOptions { steps, ..TrainOptions::preset(TrainPreset::Indoor) };
            let plan = Schedule::new(&options);
            let share = |f: &dyn Fn(u64) -> bool| {
                (0..steps).filter(|&s| f(s)).count() as f64 / steps as f64
            };
            assert!((share(&|s| plan.level(s) == 2) - 0.4).abs() < 0.01);
            assert!((share(&|s| plan.rates(s).beta_normal > 0.0) - 5.0 / 6.0).abs() < 0.01);
            assert_eq!((0..steps).filter(|&s| plan.densifies_after(s)).count(), 59);
            let first = plan.rates(0);
            let last = plan.rates(steps - 1);
            assert!((last.corners / first.corners / 0.01 - 1.0).abs() < 0.02);
            assert_eq!((first.sh_degree, last.sh_degree), (0, 3));
        }
    }

    #[test]
    fn the_solid_preset_ends_opaque_without_view_dependence() {
        let options = TrainOptions::preset(TrainPreset::Solid);
        let plan = Schedule::new(&options);
        let before = plan.scaled(options.solid.opacity_from) - 1;
        assert_eq!(
            (plan.anneal(before).opacity_floor, plan.anneal(before).opacity_gain),
            (0.0, 1.0)
        );
        assert_eq!(plan.prune_weight(before), options.densify.prune_weight);
        let last = options.steps - 1;
        assert_eq!(plan.anneal(last), Anneal::SOLID);
        let rates = plan.rates(last);
        assert_eq!((rates.sh_degree, rates.alpha_cap), (0, 1.0));
        let drawing = rates.drawing(&SoftOptions::default());
        assert!(drawing.sort == Sort::Pixel && drawing.window != Window::Soft);
        assert!((plan.prune_weight(last) - SOLID_PRUNE_WEIGHT).abs() < 1e-12);
        let opaque = plan.scaled(options.solid.opacity_until)..options.steps;
        let colors: Vec<f64> = opaque.clone().map(|s| plan.rates(s).sh).collect();
        assert!(colors[0] == SH_RATE && colors.is_sorted_by(|a, b| a > b));
        assert!((rates.sh / SH_RATE / SH_FINAL_SHARE - 1.0).abs() < 0.01);
        assert_eq!(plan.rates(opaque.start - 1).sh, SH_RATE);
        let soft = 0..opaque.start;
        let gains: Vec<f32> = soft.clone().map(|s| plan.anneal(s).opacity_gain).collect();
        assert!(gains.is_sorted() && gains.last().is_some_and(|g| *g > 0.95 * SOLID_GAIN as f32));
        let sigmas: Vec<f32> = soft.rev().map(|s| plan.anneal(s).sigma_scale).collect();
        assert!(sigmas.is_sorted());
    }

    #[test]
    fn what_follows_a_milestone_changes_nothing_before_it() {
        for preset in [TrainPreset::Solid, TrainPreset::Indoor] {
            let options = |steps, milestones| TrainOptions {
                steps,
                milestones,
                ..TrainOptions::preset(preset)
            };
            let planned = options(1003, [401, 669, 802, 903]);
            let at = |options: &TrainOptions, step: u64| {
                let plan = Schedule::new(options);
                let densifies = (
                    plan.densifies_after(step + 1),
                    plan.densification(step + 1),
                    plan.grows_after(step + 1),
                    plan.pulls_after(step + 1),
                );
                let pruned = (plan.prune_weight(step), plan.prune_opacity(step));
                (plan.rates(step), plan.level(step), densifies, pruned)
            };
            for (until, corrected) in [
                (669, options(700, [401, 669, 670, 680])),
                (669, options(672, [401, 669, 670, 671])),
                (802, options(804, [401, 669, 802, 803])),
            ] {
                assert!(
                    (0..until).all(|step| at(&planned, step) == at(&corrected, step)),
                    "{preset:?}"
                );
            }
        }
    }

    #[test]
    fn a_stretched_run_passes_what_a_plain_one_passes() {
        let options = TrainOptions {
            steps: 2000,
            milestones: [300, 900, 950, 1900],
            ..TrainOptions::preset(TrainPreset::Solid)
        };
        let plan = Schedule::new(&options);
        assert_eq!((0..2000).filter(|&s| plan.densifies_after(s)).count(), 59);
        assert_eq!([299, 300, 899, 900].map(|s| plan.level(s)), [2, 1, 1, 1]);
        assert_eq!([899, 900].map(|s| plan.is_opaque(s)), [false, true]);
        assert_eq!([949, 950].map(|s| plan.level(s)), [1, 0]);
        let last = plan.rates(1999).corners / plan.rates(900).corners;
        assert!((last / ENGINE_CORNERS_FINAL_SHARE - 1.0).abs() < 0.01, "{last}");
    }

    #[test]
    fn runs_of_any_length_have_a_plan() {
        for steps in [1u64, 2, 7, 59] {
            let options = TrainOptions { steps, ..TrainOptions::preset(TrainPreset::Solid) };
            let plan = Schedule::new(&options);
            for step in 0..steps {
                assert!(plan.rates(step).corners > 0.0);
                let _ = (plan.level(step), plan.densifies_after(step), plan.anneal(step));
            }
        }
    }
}
