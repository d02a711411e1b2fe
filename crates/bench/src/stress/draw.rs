//! One case drawn and compared: the rasterisers and the oracles, with memory that is reused from
//! case to case.

use super::axes::Axis;
use super::case::{SIDE, StressCase, StressScene};
use super::kept;
use super::promises::{PROMISES, Promise};
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;
use trisplat_formats::gltf::PositionEncoding;
use trisplat_oracle::exact::{exact_grad, oracle_camera, plain, rules, soup_grad};
use trisplat_oracle::frame::{self as oracle, Pixel};
use trisplat_oracle::ray_caster::wrong_samples;
use trisplat_raster::kernel::sh;
use trisplat_raster::soft::{FrameGrad, SoftRasterizer, SoupGrad, SoupRef};
use trisplat_raster::solid::SolidRasterizer;
use trisplat_scene::math::real::V3;
use trisplat_scene::{Result, Rng};

/// Distance to a jump below which a pixel is not compared.
pub(super) const UNDECIDED: f64 = 5e-4;
/// Distance to a jump or kink below which a pixel has no gradient: beyond it windows are above
/// `min_ratio`.
const KINK: f64 = 2e-3;
/// A gradient's error is relative to at least this share of the largest entry of all triangles.
const SMALL_SHARE: f64 = 0.02;
/// Cases with more triangles are only drawn, not compared.
const COMPARED: usize = 64;
/// Gradients are compared in cases of at most as many triangles: each is one more drawing on dual
/// numbers.
const WITH_GRADIENTS: usize = 6;
/// Times a case is drawn for its least time.
const TIMED_RUNS: usize = 25;

/// The errors of a case, by the promise that they are about; none of what was not looked at.
#[derive(Debug, Clone, Default)]
pub(super) struct Errors {
    pub(super) of: [Vec<f64>; PROMISES.len()],
    /// Pixels that are not compared, of 1.
    pub(super) undecided: f64,
}

impl Errors {
    /// The largest error.
    pub(super) fn worst(&self, promise: Promise) -> f64 {
        self.of[promise as usize].iter().copied().fold(0.0, f64::max)
    }

    fn add(&mut self, promise: Promise, error: f64) {
        self.of[promise as usize].push(error);
    }
}

/// Draws cases.
#[derive(Debug, Default)]
pub(super) struct Draw {
    soft: SoftRasterizer,
    grad: SoupGrad,
    solid: SolidRasterizer,
}

impl Draw {
    /// Seconds of the soft rasteriser on the case that is stretched along no axis.
    pub(super) fn ordinary_seconds(&mut self, seed: u64) -> f64 {
        let scene = StressScene::new(&StressCase { seed, axes: BTreeMap::new() });
        let d = random_grad(seed, &vec![1.0; (SIDE * SIDE) as usize]);
        self.least_seconds(&scene, &d, 4 * TIMED_RUNS)
    }

    /// Draws a case and compares it; gradients where asked for, files of it at `path` and bakes
    /// where there is one.
    pub(super) fn run(
        &mut self,
        case: &StressCase,
        ordinary_seconds: f64,
        gradients: bool,
        path: Option<&Path>,
    ) -> Result<Errors> {
        let scene = StressScene::new(case);
        let StressScene { soup, camera, options } = &scene;
        let compared = soup.len() <= COMPARED;
        let picture = if compared {
            oracle::render(&plain(soup), &oracle_camera(camera), &rules(options))
        } else {
            Vec::new()
        };
        let margins: Vec<f64> = if compared {
            picture.iter().map(|pixel| pixel.margin).collect()
        } else {
            vec![1.0; (SIDE * SIDE) as usize]
        };
        let d = random_grad(case.seed, &margins);
        let mut errors = Errors::default();
        let seconds = self.seconds(&scene, &d);
        self.compare_values(&scene, &picture, &mut errors);
        if gradients && soup.len() <= WITH_GRADIENTS {
            self.compare_gradients(&scene, &d, &mut errors);
        }
        if compared {
            let (mesh, solid) = scene.solid();
            let drawn = self.solid.visibility(&mesh, camera, &solid);
            let wrong = wrong_samples(drawn, &mesh, camera, f64::from(solid.near));
            errors.add(Promise::SolidSamples, wrong as f64);
        }
        if let Some(path) = path {
            let (mesh, _) = scene.solid();
            let plain = kept::half_steps(&mesh, PositionEncoding::F32, path)?;
            let stored = plain.max(kept::half_steps(&mesh, PositionEncoding::ChunkU16, path)?);
            errors.add(Promise::StoredPositions, stored);
            errors.add(Promise::BakedTriangles, kept::lost(&scene));
            errors.add(Promise::BakedNonFinite, kept::non_finite(&scene));
        }
        let layers = (case.value(Axis::Layers) / Axis::Layers.row().ordinary).max(1.0);
        let mut ratio = seconds / layers / ordinary_seconds;
        if ratio > PROMISES[Promise::Time as usize].at_most {
            // Another program's work does not count.
            ratio = self.least_seconds(&scene, &d, TIMED_RUNS) / layers / ordinary_seconds;
        }
        errors.add(Promise::Time, ratio);
        Ok(errors)
    }

    /// Seconds of the soft rasteriser, forward and backward.
    fn seconds(&mut self, scene: &StressScene, d: &FrameGrad) -> f64 {
        let soup = SoupRef::from(&scene.soup);
        let clock = Instant::now();
        self.soft.render(&soup, &scene.camera, &scene.options);
        self.soft.backward(&soup, &scene.camera, &scene.options, d, &mut self.grad);
        clock.elapsed().as_secs_f64()
    }

    fn least_seconds(&mut self, scene: &StressScene, d: &FrameGrad, runs: usize) -> f64 {
        (0..runs).map(|_| self.seconds(scene, d)).fold(f64::INFINITY, f64::min)
    }

    fn compare_values(&self, scene: &StressScene, picture: &[Pixel<f64>], errors: &mut Errors) {
        let frame = self.soft.frame();
        let numbers = frame.rgb.as_flattened().iter().chain(&frame.transmittance);
        let non_finite = numbers.filter(|number| !number.is_finite()).count() + self.grad.dropped;
        errors.add(Promise::NonFinite, non_finite as f64);
        let scale = color_scale(scene, picture);
        let mut worst = 0.0f64;
        for (i, pixel) in picture.iter().enumerate() {
            if pixel.margin < UNDECIDED {
                errors.undecided += 1.0 / picture.len() as f64;
                continue;
            }
            let t = (frame.transmittance[i], pixel.transmittance, 1.0);
            let colors = (0..3).map(|c| (frame.rgb[i][c], pixel.rgb[c], scale));
            for (got, wants, scale) in colors.chain([t]).filter(|(got, ..)| got.is_finite()) {
                let error = (f64::from(got) - wants).abs() / scale;
                worst = worst.max(error);
                errors.add(Promise::Frames, error);
            }
        }
        if !picture.is_empty() {
            errors.add(Promise::WorstFrame, worst);
        }
    }

    fn compare_gradients(&self, scene: &StressScene, d: &FrameGrad, errors: &mut Errors) {
        let StressScene { soup, camera, options } = scene;
        let k = soup.sh_count();
        let groups = [0..9, 9..10, 10..11, 11..11 + 3 * k];
        let size = |grad: &[f64]| grad.iter().fold(0.0, |m, x| f64::max(m, x.abs()));
        let exact: Vec<Vec<f64>> =
            (0..soup.len()).map(|t| exact_grad(soup, t, camera, options, d)).collect();
        for group in groups {
            let largest = exact.iter().map(|grad| size(&grad[group.clone()])).fold(0.0, f64::max);
            // At a clamped colour the oracle's slope is 0, while a gradient passes if it raises the
            // colour (docs/numerics.md).
            let smooth =
                |grad: &&(usize, &Vec<f64>)| grad.1[11..14].iter().all(|slope| *slope != 0.0);
            for (t, exact) in exact.iter().enumerate().filter(|grad| smooth(&grad)) {
                let got = &soup_grad(&self.grad, t, k)[group.clone()];
                let exact = &exact[group.clone()];
                let size = size(exact).max(SMALL_SHARE * largest);
                for (got, wants) in got.iter().zip(exact).filter(|_| size > 0.0) {
                    errors.add(Promise::Gradients, (got - wants).abs() / size);
                }
            }
        }
    }
}

/// A random gradient of a frame, zero on pixels near a kink.
fn random_grad(seed: u64, margins: &[f64]) -> FrameGrad {
    let mut d = FrameGrad::default();
    let rng = Rng::new(seed, "stress gradient", 0);
    for (i, margin) in (0u64..).zip(margins) {
        let keep = if *margin < KINK { 0.0 } else { 1.0 };
        let at = |n: u64| (rng.uniform(4 * i + n) - 0.5) * keep;
        d.d_rgb.push([at(0), at(1), at(2)]);
        d.d_transmittance.push(at(3));
    }
    d
}

/// The largest sum of magnitudes in a colour that is seen, at least 1: what a rounding error of a
/// colour is relative to.
pub(super) fn color_scale(scene: &StressScene, picture: &[Pixel<f64>]) -> f64 {
    let soup = &scene.soup;
    let k = scene.soup.sh_count();
    let rotation = scene.camera.rotation.as_dmat3();
    let translation = scene.camera.translation.as_dvec3();
    let seen = |t: &usize| picture.iter().any(|pixel| pixel.weights[*t] > 0.0);
    let size = |t: usize| {
        let centroid =
            soup.vertices[t].map(|v| v.as_dvec3()).into_iter().sum::<glam::DVec3>() / 3.0;
        let unit = (centroid + rotation.transpose() * translation).normalize();
        let basis = sh::basis(soup.sh_degree, V3::new(unit.x, unit.y, unit.z));
        let terms = |c: usize| {
            basis.iter().zip(&soup.sh[t * k..]).map(move |(b, sh)| (b * f64::from(sh[c])).abs())
        };
        (0..3).map(|c| 0.5 + terms(c).sum::<f64>()).fold(0.0, f64::max)
    };
    (0..soup.len()).filter(seen).map(size).fold(1.0, f64::max)
}
