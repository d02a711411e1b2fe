//! What training a block should take: from formulas only, so that a plan is a function of its inputs.

use super::manifest::Expected;
use glam::UVec2;
use trisplat_train::{
    REFERENCE_STEPS, TrainOptions,
    budget::{CostModel, Workload, part_secs},
};

/// Bytes of an idle process. This and the following were fitted to blocks of a town (commit b232971b).
const BASE: f64 = 15e6;
/// Bytes per optimised parameter of a trained triangle,
const PER_NUMBER: f64 = 75.0;
/// plus fixed overhead per triangle, bytes.
const PER_TRIANGLE: f64 = 250.0;
/// Parameters per triangle, without colour.
const GEOMETRY: f64 = 11.0;
/// Bytes per pixel of the largest photo, for the forward and backward pass.
const PER_PIXEL: f64 = 450.0;
/// CPU seconds per step and triangle that is only drawn, on the machine of the fit.
const DRAWN_SECS: f64 = 0.2e-6;

/// What a run works on.
#[derive(Debug, Clone)]
pub(super) struct BlockLoad {
    /// Sizes of the photos, or of their parts, px.
    pub(super) photos: Vec<UVec2>,
    /// Triangles that are only drawn.
    pub(super) frozen: u64,
    /// Triangles that are trained, at the beginning.
    pub(super) trained: u64,
    /// Position in the schedule where it begins, steps of a 30,000-step run.
    pub(super) position: f64,
    /// Memory for decoded photos, bytes.
    pub(super) photo_bytes: u64,
}

/// What a run of `load` with these options takes.
pub(super) fn expected(load: &BlockLoad, options: &TrainOptions) -> Expected {
    let areas: Vec<f64> = load.photos.iter().map(|size| size.as_dvec2().element_product()).collect();
    let (total, largest) = (areas.iter().sum::<f64>(), areas.iter().copied().fold(0.0, f64::max));
    let coefficients = (f64::from(options.sh_degree) + 1.0).powi(2);
    let per_triangle = PER_TRIANGLE + PER_NUMBER * (GEOMETRY + 3.0 * coefficients);
    let triangles = options.max_triangles.max(load.trained) + load.frozen;
    let photos = (4.0 * total).min(load.photo_bytes as f64);
    let bytes = BASE + photos + per_triangle * triangles as f64 + PER_PIXEL * largest;
    let side = (total / areas.len().max(1) as f64).sqrt().round() as u32;
    let work = Workload { position: load.position, ..Workload::at_start(UVec2::splat(side), load.trained) };
    let trained: f64 = part_secs(&CostModel::FITTED, &work, options).iter().sum();
    let steps = options.steps as f64 * (1.0 - load.position / REFERENCE_STEPS);
    let cpu_secs = trained + steps * load.frozen as f64 * DRAWN_SECS;
    Expected { bytes: bytes as u64, cpu_secs: (cpu_secs * 10.0).round() / 10.0 }
}
