//! Plans a budget: the steps, the triangles and the size of the photos.

use super::cost::{Calibration, Workload, part_secs};
use crate::options::TrainOptions;
use crate::timeline::Timeline;
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::Dataset;
use trisplat_scene::{Budget, Error, Result};

/// Triangles per step, by the least error at equal cost (docs/benchmarks/history.md).
const TRIANGLES_PER_STEP: f64 = 14.0;

/// Limits of a run with any budget.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepLimit {
    /// More steps than this gain nothing.
    pub steps: Option<u64>,
    /// Most triangles per step.
    pub triangles_per_step: f64,
    /// Fewer steps than this are worth smaller photos.
    pub steps_of_full_photos: u64,
}

impl Default for StepLimit {
    fn default() -> Self {
        Self { steps: None, triangles_per_step: TRIANGLES_PER_STEP, steps_of_full_photos: ENOUGH_STEPS }
    }
}

/// Least pixels of the training photos per triangle: more triangles overfit the photos.
const PIXELS_PER_TRIANGLE: f64 = 80.0;

/// Fewer steps than this are worth smaller photos, unless a run has its own number.
const ENOUGH_STEPS: u64 = 1000;

/// Photos are not made smaller than this on their longer side, px.
const SMALLEST_PHOTO: u32 = 320;

/// Fewer steps do not give a usable scene.
const FEWEST_STEPS: u64 = 60;

/// Least triangles, unless the scene begins with more.
const FEWEST_TRIANGLES: u64 = 1000;

/// Most triangles.
const MOST_TRIANGLES: u64 = 1_000_000;

/// The inputs of a plan.
#[derive(Debug, Clone)]
pub struct PlanInput<'a> {
    /// The options of the run; its steps, its milestones and, unless given, its triangles are chosen.
    pub options: &'a TrainOptions,
    /// The budget.
    pub budget: Budget,
    /// Seconds spent already.
    pub spent_secs: f64,
    /// How fast the machine is.
    pub calibration: Calibration,
    /// Training photos.
    pub photos: u64,
    /// Held-out photos.
    pub held_out: u64,
    /// The size of the training photos, px: the largest.
    pub photo: UVec2,
    /// `max_triangles` is given.
    pub triangles_given: bool,
    /// `max_size` is given, or cannot be chosen.
    pub size_given: bool,
    /// The run starts from a scene, whose triangles must all fit.
    pub from_scene: bool,
    /// What is enough for it.
    pub enough: StepLimit,
}

/// A plan for a budget.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plan {
    /// Steps.
    pub steps: u64,
    /// Most triangles.
    pub max_triangles: u64,
    /// The longer side of the photos, px; null: unchanged.
    pub max_size: Option<u32>,
    /// Expected seconds of the steps.
    pub step_secs: f64,
    /// Seconds reserved for evaluation and writing.
    pub reserve_secs: f64,
}

impl<'a> PlanInput<'a> {
    /// Of a data set after reading.
    pub fn new(
        dataset: &Dataset,
        options: &'a TrainOptions,
        budget: Budget,
        spent_secs: f64,
        calibration: Calibration,
    ) -> Self {
        let sizes = dataset.train().map(|view| view.photo.size);
        Self {
            options,
            budget,
            spent_secs,
            calibration,
            photos: dataset.train().count() as u64,
            held_out: dataset.test().count() as u64,
            photo: sizes.max_by_key(|size| size.element_product()).unwrap_or(UVec2::ONE),
            triangles_given: false,
            size_given: false,
            from_scene: false,
            enough: StepLimit::default(),
        }
    }

    /// True when `plan` has all useful steps.
    pub fn is_enough(&self, plan: &Plan) -> bool {
        self.enough.steps.is_some_and(|most| plan.steps >= most)
    }

    /// The size of photos whose longer side is `max_size`.
    pub fn photo_of(&self, max_size: Option<u32>) -> UVec2 {
        let longer = self.photo.max_element();
        let most = max_size.unwrap_or(longer).min(longer);
        (self.photo.as_dvec2() * f64::from(most) / f64::from(longer)).round().as_uvec2().max(UVec2::ONE)
    }

    /// Seconds for the work after the last step, with photos of `photo`.
    fn reserve_secs(&self, photo: UVec2) -> f64 {
        let smaller = photo.as_dvec2().element_product() / self.photo.as_dvec2().element_product();
        self.held_out as f64 * self.calibration.evaluate_secs * smaller
    }

    /// Seconds of a run of `options` up to its last step.
    fn run_secs(&self, options: &TrainOptions, photo: UVec2) -> f64 {
        let triangles = self.calibration.triangles.min(options.max_triangles);
        let workload = Workload::at_start(photo, triangles);
        let steps: f64 = part_secs(&self.calibration.model, &workload, options).iter().sum();
        // Held-out photos are decoded once, too.
        let decoded = self.photos.min(options.steps) + self.held_out;
        steps + decoded as f64 * self.calibration.decode_secs
    }
}

/// Chooses steps, triangles and the size of photos. The rule: the most steps that fit, with fourteen
/// triangles per step, and unchanged photos unless that leaves too few steps.
///
/// Errors: a budget too small for any scene.
pub fn plan(input: &PlanInput<'_>) -> Result<Plan> {
    let mut size = None;
    loop {
        let photo = input.photo_of(size);
        let plan = for_size(input, size);
        let smaller = (photo.max_element() * 3 / 4).max(SMALLEST_PHOTO);
        let enough = plan
            .as_ref()
            .is_some_and(|plan| plan.steps >= input.enough.steps_of_full_photos || input.is_enough(plan));
        if enough || input.size_given || smaller >= photo.max_element() {
            return plan.ok_or_else(|| too_small(input, photo));
        }
        size = Some(smaller);
    }
}

/// The plan for photos of one size; `None` if the budget is too small for it.
fn for_size(input: &PlanInput<'_>, max_size: Option<u32>) -> Option<Plan> {
    let photo = input.photo_of(max_size);
    let reserve_secs = input.reserve_secs(photo);
    let left = input.budget.seconds.0 - input.spent_secs - reserve_secs;
    let options = |steps: u64| {
        let max_triangles = triangles_for(input, photo, steps);
        TrainOptions { steps, max_triangles, milestones: [0; 4], ..input.options.clone() }
    };
    // Seconds rise with the steps: the most steps that fit lie between two of these.
    let fits = |steps: u64| input.run_secs(&options(steps), photo) <= left;
    let (mut low, mut high) = (FEWEST_STEPS, 2 * FEWEST_STEPS);
    if !fits(low) {
        return None;
    }
    let most = input.enough.steps.unwrap_or(1 << 40).max(FEWEST_STEPS);
    while fits(high) && high < most {
        (low, high) = (high, 2 * high);
    }
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        *(if fits(middle) { &mut low } else { &mut high }) = middle;
    }
    let chosen = options(low.min(most));
    let step_secs = input.run_secs(&chosen, photo);
    let max_triangles = chosen.max_triangles;
    Some(Plan { steps: chosen.steps, max_triangles, max_size, step_secs, reserve_secs })
}

/// The most triangles of a run of `steps`.
fn triangles_for(input: &PlanInput<'_>, photo: UVec2, steps: u64) -> u64 {
    if input.triangles_given {
        return input.options.max_triangles;
    }
    let pixels = input.photos as f64 * photo.as_dvec2().element_product();
    let most = (pixels / PIXELS_PER_TRIANGLE).clamp(FEWEST_TRIANGLES as f64, MOST_TRIANGLES as f64);
    let triangles =
        (input.enough.triangles_per_step * steps as f64).clamp(FEWEST_TRIANGLES as f64, most).round() as u64;
    if input.from_scene { triangles.max(input.calibration.triangles) } else { triangles }
}

fn too_small(input: &PlanInput<'_>, photo: UVec2) -> Error {
    let least = TrainOptions {
        steps: FEWEST_STEPS,
        max_triangles: triangles_for(input, photo, FEWEST_STEPS),
        milestones: [0; 4],
        ..input.options.clone()
    };
    let needed = input.spent_secs + input.reserve_secs(photo) + input.run_secs(&least, photo);
    let budget = input.budget;
    let wants = format!("{}s or more for this data set on this machine", (1.2 * needed).ceil().max(1.0));
    Error::invalid(budget.option(), budget.seconds, wants)
}

impl Plan {
    /// `options` with the choices. Their milestones are explicit, because they may change.
    pub fn apply(&self, options: &TrainOptions) -> TrainOptions {
        TrainOptions {
            steps: self.steps,
            max_triangles: self.max_triangles,
            milestones: Timeline::proportional(self.steps),
            ..options.clone()
        }
    }
}
