//! What changes from step to step: rates, resolution, SH degree, regularisers, refinements, the anneal.

use super::options::{REFERENCE_STEPS, TrainOptions};
use super::params::Anneal;

/// Largest alpha of a layer of the soft scene (3DGS).
pub const ALPHA_CAP: f32 = 0.99;

/// Everything of one step that is not the scene or the photo.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    /// Steps Adam has made after this one, from 1.
    pub time: u64,
    /// Rate of the corners.
    pub vertices: f64,
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
    /// λ of 1 - SSIM.
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
    /// Largest alpha of a layer; it lifts to 1 with the anneal, else every solid triangle would leak.
    pub alpha_cap: f32,
    /// How solid the scene is.
    pub anneal: Anneal,
}

/// The plan of a run: a pure function of the step.
#[derive(Debug, Clone, Copy)]
pub struct Schedule<'a> {
    options: &'a TrainOptions,
}

impl<'a> Schedule<'a> {
    /// The plan these options describe.
    pub fn new(options: &'a TrainOptions) -> Self {
        Self { options }
    }

    /// A position in a 30,000-step run as a step of this run.
    pub fn scaled(&self, position: f64) -> u64 {
        (position * self.options.steps as f64 / REFERENCE_STEPS).round() as u64
    }

    /// What step `step` (from 0) works with.
    pub fn rates(&self, step: u64) -> Rates {
        let (o, r, l) = (self.options, &self.options.rates, &self.options.loss);
        let done = step as f64 / o.steps.max(1) as f64;
        let others = r.final_share.powf(done);
        let geometry = step >= self.scaled(l.geometry_from);
        Rates {
            time: step + 1,
            vertices: r.vertices * r.vertices_final.powf(done),
            opacity: r.opacity * others,
            sigma: r.sigma * others,
            sh: r.sh * others,
            sh_rest: r.sh * r.sh_rest * others,
            sh_degree: self.sh_degree(step),
            dssim: l.dssim,
            beta_opacity: l.opacity,
            beta_distortion: if geometry { l.distortion } else { 0.0 },
            beta_normal: if geometry { l.normal } else { 0.0 },
            beta_size: if step < self.scaled(l.size_until) { l.size } else { 0.0 },
            sparse: r.sparse,
            alpha_cap: ALPHA_CAP.max(self.anneal(step).opacity_floor),
            anneal: self.anneal(step),
        }
    }

    /// Degrees of view-dependent colour in use: one more every `sh_every`, none once the scene turns solid.
    pub fn sh_degree(&self, step: u64) -> u8 {
        let o = self.options;
        if self.is_solid(step) {
            return 0;
        }
        let every = self.scaled(o.rates.sh_every).max(1);
        u8::try_from(step / every).unwrap_or(u8::MAX).min(o.sh_degree)
    }

    /// Times the photo is halved at this step: 2, 1 or 0.
    pub fn level(&self, step: u64) -> u32 {
        let w = &self.options.warmup;
        if step < self.scaled(w.quarter_until) { 2 } else { u32::from(step < self.scaled(w.half_until)) }
    }

    /// True from the first step of the solid anneal on.
    pub fn is_solid(&self, step: u64) -> bool {
        self.options.solid.enabled && step >= self.scaled(self.options.solid.from)
    }

    /// How much of the solid anneal is done after `step`: 0 to 1, linearly.
    fn annealed(&self, step: u64) -> f64 {
        let s = &self.options.solid;
        if !self.is_solid(step) {
            return 0.0;
        }
        let (from, until) = (self.scaled(s.from), self.scaled(s.until).max(self.scaled(s.from) + 1));
        ((step - from + 1) as f64 / (until - from) as f64).min(1.0)
    }

    /// How solid triangles are at `step`: the floor rises linearly, σ falls log-linearly.
    pub fn anneal(&self, step: u64) -> Anneal {
        let (s, done) = (&self.options.solid, self.annealed(step));
        if done == 0.0 {
            return Anneal::NONE;
        }
        Anneal { opacity_floor: (s.opacity * done) as f32, sigma_scale: s.sigma_scale.powf(done) as f32 }
    }

    /// τ_prune after `step`. It rises with the anneal: a soft scene is made of small weights, and the solid
    /// threshold would delete it at once.
    pub fn prune_weight(&self, step: u64) -> f64 {
        let (soft, solid) = (self.options.refine.prune_weight, self.options.solid.prune_weight);
        soft + (solid - soft) * self.annealed(step)
    }

    /// True when the scene is refined after `step` steps have been made.
    pub fn refines_after(&self, step: u64) -> bool {
        let r = &self.options.refine;
        let every = self.scaled(r.every).max(1);
        step >= self.scaled(r.from).max(1) && step.is_multiple_of(every) && step < self.options.steps
    }

    /// True while a refinement after `step` steps may add triangles.
    pub fn grows_after(&self, step: u64) -> bool {
        step < self.scaled(self.options.refine.until) && !self.is_solid(step)
    }

    /// Which refinement the one after `step` steps is, counted over the whole run.
    pub fn refinement(&self, step: u64) -> u64 {
        step / self.scaled(self.options.refine.every).max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::options::Preset;

    #[test]
    fn positions_scale_with_the_run() {
        for steps in [300u64, 3000, 30_000] {
            let options = TrainOptions { steps, ..TrainOptions::preset(Preset::Indoor) };
            let plan = Schedule::new(&options);
            let share = |f: &dyn Fn(u64) -> bool| (0..steps).filter(|&s| f(s)).count() as f64 / steps as f64;
            assert!((share(&|s| plan.level(s) == 2) - 0.4).abs() < 0.01);
            assert!((share(&|s| plan.rates(s).beta_normal > 0.0) - 5.0 / 6.0).abs() < 0.01);
            assert_eq!((0..steps).filter(|&s| plan.refines_after(s)).count(), 59);
            let (first, last) = (plan.rates(0), plan.rates(steps - 1));
            assert!((last.vertices / first.vertices / 0.01 - 1.0).abs() < 0.02);
            assert_eq!((first.sh_degree, last.sh_degree), (0, 3));
        }
    }

    #[test]
    fn solid_ends_solid_without_view_dependence() {
        let options = TrainOptions::preset(Preset::Solid);
        let plan = Schedule::new(&options);
        let before = plan.scaled(25_000.0) - 1;
        assert_eq!(plan.anneal(before), Anneal::NONE);
        let last = plan.anneal(options.steps - 1);
        assert!(last.opacity_floor > 0.999 && last.sigma_scale < 0.011);
        assert_eq!(plan.rates(options.steps - 1).sh_degree, 0);
        assert_eq!(plan.prune_weight(before), options.refine.prune_weight);
        assert!((plan.prune_weight(options.steps - 1) - options.solid.prune_weight).abs() < 1e-12);
        let floors: Vec<f32> = (before..options.steps).map(|s| plan.anneal(s).opacity_floor).collect();
        assert!(floors.is_sorted());
    }

    #[test]
    fn runs_of_any_length_have_a_plan() {
        for steps in [1u64, 2, 7, 59] {
            let options = TrainOptions { steps, ..TrainOptions::preset(Preset::Solid) };
            let plan = Schedule::new(&options);
            for step in 0..steps {
                assert!(plan.rates(step).vertices > 0.0);
                let _ = (plan.level(step), plan.refines_after(step), plan.anneal(step));
            }
        }
    }
}
