//! The cost of a step in seconds, from the pixels of its photo, the triangles of the scene and the kind of
//! drawing.
//!
//! The coefficients were fitted to the curves of runs on four scenes (docs/benchmarks/budget.md). The
//! speed of this machine on this scene is a factor for soft steps and one for steps with engine shading. A
//! few steps at the start of a run measure both, and the run corrects them.

use crate::options::{REFERENCE_STEPS, TrainOptions};
use crate::pyramid::{MIN_PX, size_at};
use crate::schedule::{REFINE_FROM, Schedule};
use crate::timeline::{MILESTONES, Timeline};
use glam::UVec2;
use serde::{Deserialize, Serialize};

/// What a step works on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepLoad {
    /// Pixels of the photo.
    pub pixels: f64,
    /// Triangles of the scene.
    pub triangles: f64,
    /// Drawn as an engine draws.
    pub engine_shading: bool,
    /// Depth and normals are drawn as well.
    pub geometry: bool,
}

impl StepLoad {
    /// Of step `step` (from 0) of a run of `options`, with photos of `photo` px at full size.
    pub fn of_step(options: &TrainOptions, step: u64, photo: UVec2, triangles: f64) -> Self {
        let schedule = Schedule::new(options);
        let rates = schedule.rates(step);
        let size = size_at(photo, schedule.level(step), MIN_PX);
        Self {
            pixels: size.as_dvec2().element_product(),
            triangles,
            engine_shading: rates.engine_shading.is_some(),
            geometry: rates.beta_normal > 0.0 || rates.beta_distortion > 0.0,
        }
    }
}

/// CPU seconds of a step on the machine of the fit: a constant, per triangle and per pixel, soft and with engine shading.
const FITTED: [[f64; 3]; 2] = [[1.1e-3, 0.52e-6, 0.067e-6], [0.0, 0.76e-6, 0.143e-6]];

/// Factor for a step that also draws depth and normals.
const GEOMETRY: f64 = 1.5;

/// Triangles after a densification, as a share of their number without pruning.
const KEPT: f64 = 0.96;

/// The cost of steps, in seconds of the budget's clock.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct CostModel {
    /// Seconds per second of the fit, for soft steps and for steps with engine shading.
    pub scale: [f64; 2],
}

impl CostModel {
    /// A machine and a scene like those of the fit.
    pub const FITTED: Self = Self { scale: [1.0; 2] };

    /// Seconds of a step.
    pub fn step_secs(&self, load: &StepLoad) -> f64 {
        let kind = usize::from(load.engine_shading);
        let [constant, per_triangle, per_pixel] = FITTED[kind];
        let geometry = if load.geometry { GEOMETRY } else { 1.0 };
        self.scale[kind] * geometry * (constant + per_triangle * load.triangles + per_pixel * load.pixels)
    }
}

/// Measurements before a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Calibration {
    /// What steps cost.
    pub model: CostModel,
    /// Triangles at the beginning.
    pub triangles: u64,
    /// Seconds to decode a photo.
    pub decode_secs: f64,
    /// Seconds to draw the scene for a held-out photo and to compare them.
    pub evaluate_secs: f64,
}

/// The scene and the photos of the steps to predict.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Workload {
    /// The median size of the training photos, px.
    pub photo: UVec2,
    /// Triangles there are.
    pub triangles: u64,
    /// The position, of a 30,000-step run, where the triangles were counted.
    pub position: f64,
    /// Growth by a densification, as a factor; none: the growth that the options permit, minus usual pruning.
    pub growth: Option<f64>,
}

impl Workload {
    /// A scene of `triangles` at the beginning.
    pub fn at_start(photo: UVec2, triangles: u64) -> Self {
        Self { photo, triangles, position: 0.0, growth: None }
    }

    /// Sets the growth by which densifications reached `triangles` at `position`.
    pub fn growth_to(&self, triangles: u64, position: f64, options: &TrainOptions) -> f64 {
        let densifications = densifications([self.position, position], options).max(1.0);
        let factor = (triangles as f64 / self.triangles.max(1) as f64).powf(1.0 / densifications);
        factor.clamp(1.0, most_growth(options))
    }
}

/// Densifications between two positions.
fn densifications([from, until]: [f64; 2], options: &TrainOptions) -> f64 {
    let densify = &options.densify;
    let from = from.max(REFINE_FROM - densify.every);
    ((until.min(densify.until) - from) / densify.every).max(0.0).floor()
}

/// Growth by a full densification, as a factor.
fn most_growth(options: &TrainOptions) -> f64 {
    ((1.0 + options.densify.growth) * KEPT).max(1.0)
}

/// Positions per cell of constant load.
const CELL: f64 = 250.0;

/// Seconds of the steps of each part between two milestones, from `workload.position` on.
pub fn part_secs(model: &CostModel, workload: &Workload, options: &TrainOptions) -> [f64; 5] {
    let mut secs = [0.0; 5];
    // In a run of 30,000 steps, positions and steps are the same.
    let reference = TrainOptions { steps: REFERENCE_STEPS as u64, milestones: [0; 4], ..options.clone() };
    let timeline = Timeline::new(options);
    let mut position = workload.position;
    while position < REFERENCE_STEPS {
        let end = next_cell(position);
        let middle = 0.5 * (position + end);
        let triangles = triangles_at(middle, workload, options);
        let load = StepLoad::of_step(&reference, middle as u64, workload.photo, triangles);
        let part = MILESTONES.iter().filter(|milestone| **milestone <= position).count();
        let density = timeline.density(timeline.step_at(position)) / REFERENCE_STEPS;
        secs[part] += (end - position) * density * model.step_secs(&load);
        position = end;
    }
    secs
}

/// The end of the cell that begins at `position`; no cell reaches beyond a milestone.
fn next_cell(position: f64) -> f64 {
    let end = ((position / CELL).floor() + 1.0) * CELL;
    MILESTONES.into_iter().filter(|milestone| *milestone > position).fold(end.min(REFERENCE_STEPS), f64::min)
}

/// The expected number of triangles: it grows at each densification up to the limit.
fn triangles_at(position: f64, workload: &Workload, options: &TrainOptions) -> f64 {
    let factor = workload.growth.unwrap_or_else(|| most_growth(options));
    let densifications = densifications([workload.position, position], options).min(1e3);
    (workload.triangles as f64 * factor.powf(densifications)).min(options.max_triangles as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn workload(position: f64) -> Workload {
        Workload { position, ..Workload::at_start(UVec2::new(480, 270), 10_000) }
    }

    fn options(steps: u64) -> TrainOptions {
        TrainOptions { steps, max_triangles: 40_000, ..TrainOptions::default() }
    }

    #[test]
    fn twice_the_steps_cost_twice_as_much() {
        let secs = |steps| part_secs(&CostModel::FITTED, &workload(0.0), &options(steps)).iter().sum::<f64>();
        assert!((secs(2000) / secs(1000) - 2.0).abs() < 1e-9);
        assert!(secs(1000) > 1.0);
    }

    #[test]
    fn a_part_costs_what_its_own_steps_do() {
        let plain = part_secs(&CostModel::FITTED, &workload(0.0), &options(1000));
        let milestones = [400, 667, 800, 1100];
        let longer = TrainOptions { milestones, ..options(1200) };
        let longer = part_secs(&CostModel::FITTED, &workload(0.0), &longer);
        for (part, factor) in [(0, 1.0), (1, 1.0), (2, 1.0), (3, 3.0), (4, 1.0)] {
            assert!((longer[part] / plain[part] / factor - 1.0).abs() < 0.01, "{part}: {plain:?} {longer:?}");
        }
        let late = part_secs(&CostModel::FITTED, &workload(24_000.0), &options(1000));
        assert_eq!(late[..3], [0.0; 3]);
        assert!(late[3] > 0.0 && late[3] <= plain[3]);
    }

    #[test]
    fn full_photos_with_engine_shading_cost_most() {
        let step = |pixels, engine_shading| {
            let load = StepLoad { pixels, triangles: 4e4, engine_shading, geometry: false };
            CostModel { scale: [2.0, 3.0] }.step_secs(&load)
        };
        assert!(step(130e3, true) > step(32e3, true));
        assert!(step(130e3, true) > step(130e3, false));
    }
}
