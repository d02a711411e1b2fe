//! One case drawn and compared: the rasterisers and the reference, with memory that is reused from case to case.

use super::axes::Axis;
use super::case::StressCase;
use super::exact::{ExactFrame, UNDECIDED};
use super::exact_grad::ExactGrad;
use super::ray_caster::wrong_samples;
use super::scene::StressScene;
use std::time::Instant;
use trisplat_raster::{
    soft::{FrameGrad, SoftRasterizer, SoupGrad, SoupRef},
    solid::SolidRasterizer,
};
use trisplat_scene::Rng;

/// A gradient's error is relative to at least this share of the largest entry of all triangles.
const SMALL_SHARE: f64 = 0.02;
/// Cases with more triangles than this are not given to the ray caster, which tests every pair of face and sample.
const RAY_CAST_FACES: usize = 64;

/// What a case gave.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Outcome {
    /// Whether a triangle is seen.
    pub(super) drawn: bool,
    /// Pixels that are not compared.
    pub(super) undecided: u64,
    /// Numbers that are not finite, and gradients that were dropped for it.
    pub(super) non_finite: u64,
    /// Wrong samples of the solid rasteriser.
    pub(super) solid_wrong: u64,
    /// Largest error of a value.
    pub(super) worst_value: f64,
    /// Largest error of an entry of a gradient.
    pub(super) worst_gradient: f64,
    /// Seconds of the soft rasteriser, forward and backward.
    pub(super) seconds: f64,
}

/// Draws cases.
#[derive(Debug, Default)]
pub(super) struct Rig {
    soft: SoftRasterizer,
    grad: SoupGrad,
    d: FrameGrad,
    exact: ExactFrame,
    solid: SolidRasterizer,
    /// Errors of the values of the last case.
    pub(super) values: Vec<f64>,
    /// Errors of the entries of gradients of the last case.
    pub(super) gradients: Vec<f64>,
}

impl Rig {
    /// Draws a case and compares it.
    pub(super) fn run(&mut self, case: &StressCase) -> Outcome {
        let scene = StressScene::new(case);
        let StressScene { soup, camera, options } = &scene;
        self.exact.draw(soup, camera, options);
        self.frame_grad(case.seed);
        let reference = SoupRef::from(soup);
        let clock = Instant::now();
        self.soft.render(&reference, camera, options);
        self.soft.backward(&reference, camera, options, &self.d, &mut self.grad);
        let seconds = clock.elapsed().as_secs_f64();
        let mut outcome = Outcome { drawn: self.exact.drawn(), seconds, ..Outcome::default() };
        self.compare_values(&mut outcome);
        let exact = self.exact.backward(soup, camera, options, &self.d);
        self.compare_gradients(&exact, soup.sh_count(), &mut outcome);
        if soup.len() <= RAY_CAST_FACES {
            let (mesh, solid_options) = scene.solid();
            let drawn = self.solid.visibility(&mesh, camera, &solid_options);
            outcome.solid_wrong = wrong_samples(drawn, &mesh, camera, f64::from(solid_options.near)) as u64;
        }
        outcome
    }

    /// Least seconds of the soft rasteriser on a case, forward and backward, of `runs`.
    pub(super) fn least_seconds(&mut self, case: &StressCase, runs: usize) -> f64 {
        let StressScene { soup, camera, options } = StressScene::new(case);
        self.exact.draw(&soup, &camera, &options);
        self.frame_grad(case.seed);
        let soup = SoupRef::from(&soup);
        let mut least = f64::INFINITY;
        for _ in 0..runs {
            let clock = Instant::now();
            self.soft.render(&soup, &camera, &options);
            self.soft.backward(&soup, &camera, &options, &self.d, &mut self.grad);
            least = least.min(clock.elapsed().as_secs_f64());
        }
        least
    }

    /// A random gradient of the frame, zero on pixels that are not compared.
    fn frame_grad(&mut self, seed: u64) {
        self.d.d_rgb.clear();
        self.d.d_transmittance.clear();
        let rng = Rng::new(seed, "stress gradient", 0);
        for (i, margin) in (0u64..).zip(&self.exact.margin) {
            let keep = if *margin < UNDECIDED { 0.0 } else { 1.0 };
            let at = |n: u64| (rng.uniform(4 * i + n) - 0.5) * keep;
            self.d.d_rgb.push([at(0), at(1), at(2)]);
            self.d.d_transmittance.push(at(3));
        }
    }

    fn compare_values(&mut self, outcome: &mut Outcome) {
        self.values.clear();
        let frame = self.soft.frame();
        let scale = self.exact.color_scale;
        for (i, margin) in self.exact.margin.iter().enumerate() {
            let ([r, g, b], [er, eg, eb]) = (frame.rgb[i], self.exact.rgb[i]);
            let pairs = [(r, er, scale), (g, eg, scale), (b, eb, scale)];
            let t = (frame.transmittance[i], self.exact.transmittance[i], 1.0);
            for (got, want, scale) in pairs.into_iter().chain([t]) {
                if !got.is_finite() {
                    outcome.non_finite += 1;
                } else if *margin >= UNDECIDED {
                    self.values.push((f64::from(got) - want).abs() / scale);
                }
            }
            outcome.undecided += u64::from(*margin < UNDECIDED);
        }
        outcome.worst_value = self.values.iter().copied().fold(0.0, f64::max);
    }

    fn compare_gradients(&mut self, exact: &[ExactGrad], k: usize, outcome: &mut Outcome) {
        self.gradients.clear();
        outcome.non_finite += self.grad.dropped as u64;
        let groups = [0..9, 9..10, 10..11, 11..11 + 3 * k];
        let size =
            |grad: &[f64], g: usize| grad[groups[g].clone()].iter().fold(0.0, |m, x| f64::max(m, x.abs()));
        let mut largest = [0.0f64; 4];
        for grad in exact {
            let grad = grad.numbers();
            (0..4).for_each(|g| largest[g] = largest[g].max(size(&grad, g)));
        }
        for (t, exact) in exact.iter().enumerate().filter(|(t, _)| !self.exact.kinked[*t]) {
            let (got, exact) = (self.single(t, k).numbers(), exact.numbers());
            for (g, range) in groups.iter().enumerate() {
                let size = size(&exact, g).max(SMALL_SHARE * largest[g]);
                for n in range.clone() {
                    if !got[n].is_finite() {
                        outcome.non_finite += 1;
                    } else if size > 0.0 {
                        self.gradients.push((got[n] - exact[n]).abs() / size);
                    }
                }
            }
        }
        outcome.worst_gradient = self.gradients.iter().copied().fold(0.0, f64::max);
    }

    /// The gradient that the rasteriser gave for a triangle.
    fn single(&self, t: usize, k: usize) -> ExactGrad {
        let mut out = ExactGrad {
            vertices: self.grad.vertices[t].map(|v| v.as_dvec3()),
            opacity: f64::from(self.grad.opacity[t]),
            sigma: f64::from(self.grad.sigma[t]),
            ..ExactGrad::default()
        };
        for (out, got) in out.sh.iter_mut().zip(&self.grad.sh[t * k..(t + 1) * k]) {
            *out = got.map(f64::from);
        }
        out
    }
}

/// Layers of a case over those of the ordinary one: what its time may grow by.
pub(super) fn layers_over_ordinary(case: &StressCase) -> f64 {
    (case.value(Axis::Layers) / Axis::Layers.row().ordinary).max(1.0)
}
