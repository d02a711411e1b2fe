//! Expected time of steps, by a model of their cost.

use crate::options::{REFERENCE_STEPS, TrainOptions};
use crate::pyramid::{MIN_PX, size_at};
use crate::schedule::Schedule;
use crate::timeline::{MILESTONES, Timeline};
use glam::UVec2;

/// Seconds of a step: a constant, per triangle and per pixel, soft and with engine shading. Only
/// their proportions count, because [`speed`](crate::measure_speed) measures the machine.
const STEP_SECS: [[f64; 3]; 2] = [[0.75e-3, 0.36e-6, 0.046e-6], [0.0, 0.53e-6, 0.1e-6]];

/// Expected CPU seconds of the steps of each part between two milestones, with photos of `photo`
/// and this number of triangles.
pub fn part_secs(options: &TrainOptions, photo: UVec2, triangles: u64) -> [f64; 5] {
    // In a run of 30,000 steps, positions and steps are the same.
    let reference =
        TrainOptions { steps: REFERENCE_STEPS as u64, milestones: [0; 4], ..options.clone() };
    let schedule = Schedule::new(&reference);
    let ends = ends(options);
    std::array::from_fn(|part| {
        let before =
            part.checked_sub(1).map_or((0, 0.0), |before| (ends[before], MILESTONES[before]));
        let until = MILESTONES.get(part).copied().unwrap_or(REFERENCE_STEPS);
        let middle = (0.5 * (before.1 + until)) as u64;
        let pixels = size_at(photo, schedule.level(middle), MIN_PX).as_dvec2().element_product();
        // The scene grows in the first part.
        let triangles = triangles as f64 * if part == 0 { 0.5 } else { 1.0 };
        let steps = ends[part].saturating_sub(before.0) as f64;
        steps * step_secs(schedule.is_opaque(middle), triangles, pixels)
    })
}

/// Expected seconds of one step, with engine shading if `is_opaque`.
pub(crate) fn step_secs(is_opaque: bool, triangles: f64, pixels: f64) -> f64 {
    let [constant, per_triangle, per_pixel] = STEP_SECS[usize::from(is_opaque)];
    constant + per_triangle * triangles + per_pixel * pixels
}

/// The run between milestones, with the steps of each part at its end.
pub(super) fn ends(options: &TrainOptions) -> [u64; 5] {
    let [a, b, c, d] = match options.milestones {
        [0, 0, 0, 0] => Timeline::proportional(options.steps),
        milestones => milestones,
    };
    [a, b, c, d, options.steps]
}
