//! The plan for a budget: steps, triangles and the size of photos.

use super::cost::part_secs;
use crate::options::TrainOptions;
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::Dataset;
use trisplat_scene::{Budget, Error, Result, Seconds};
/// Seconds per pixel to decode a photo, and to draw and compare a held-out one, in the same unit.
const DECODE_SECS: f64 = 10e-9;
const EVALUATE_SECS: f64 = 0.3e-6;
/// Triangles per step, by the least error at equal cost (docs/benchmarks/history.md).
const TRIANGLES_PER_STEP: f64 = 14.0;
/// Minimum pixels of the training photos per triangle: more triangles overfit the photos.
const PIXELS_PER_TRIANGLE: f64 = 80.0;
/// Below this number of steps the plan makes photos smaller, unless a run has its own number.
const ENOUGH_STEPS: u64 = 1000;
/// Smallest longer side of photos that a plan chooses, px.
const SMALLEST_PHOTO: u32 = 320;
/// Minimum number of steps for a usable scene.
const FEWEST_STEPS: u64 = 60;
/// Minimum, unless the scene begins with more triangles, and maximum number of triangles.
const TRIANGLES: [f64; 2] = [1e3, 1e6];

/// Limits of a run with any budget.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StepLimit {
    /// Steps beyond which a run gains nothing.
    pub steps: Option<u64>,
    /// Steps below which the plan makes photos smaller.
    pub steps_of_full_photos: u64,
}

impl Default for StepLimit {
    fn default() -> Self {
        Self { steps: None, steps_of_full_photos: ENOUGH_STEPS }
    }
}

/// A plan for a budget.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Plan {
    /// Steps.
    pub steps: u64,
    /// Maximum number of triangles.
    pub max_triangles: u64,
    /// The longer side of the photos, px; null: unchanged.
    pub max_size: Option<u32>,
    /// Expected seconds of the steps.
    pub step_secs: f64,
    /// Seconds reserved for evaluation and writing.
    pub reserve_secs: f64,
}

/// Inputs of a plan.
#[derive(Debug, Clone)]
pub struct PlanInput<'a> {
    /// The options of the run; its steps, its milestones and, unless given, its triangles are
    /// chosen.
    pub options: &'a TrainOptions,
    /// The budget.
    pub budget: Budget,
    /// Seconds spent already.
    pub spent_secs: f64,
    /// The machine's [`speed`](crate::measure_speed).
    pub speed: f64,
    /// Training photos, and held-out ones.
    pub photos: [u64; 2],
    /// The size of the largest training photo, px.
    pub photo: UVec2,
    /// Keep `max_triangles` of the options.
    pub keeps_max_triangles: bool,
    /// Keep the size of the photos.
    pub keeps_photo_size: bool,
    /// Triangles of the scene that the run starts from, which must all fit.
    pub from: Option<u64>,
    /// Numbers of steps beyond which time gains less.
    pub step_limit: StepLimit,
    /// The budget that was asked for, if this is a part of it.
    pub whole: Option<WholeBudget>,
}

/// A budget whose parts are planned one by one.
#[derive(Debug, Clone, Copy)]
pub struct WholeBudget {
    /// All of it.
    pub seconds: Seconds,
    /// Seconds of the whole for each second of the part: whole = scale · part + offset.
    pub scale: f64,
    /// Seconds of the whole when the part has none.
    pub offset: f64,
}

impl<'a> PlanInput<'a> {
    /// Inputs of a data set after reading.
    pub fn new(
        dataset: &Dataset,
        options: &'a TrainOptions,
        budget: Budget,
        spent_secs: f64,
        speed: f64,
    ) -> Self {
        let sizes = dataset.train().map(|view| view.photo.size);
        Self {
            options,
            budget,
            spent_secs,
            speed,
            photos: [dataset.train().count(), dataset.test().count()].map(|count| count as u64),
            photo: sizes.max_by_key(|size| size.element_product()).unwrap_or(UVec2::ONE),
            keeps_max_triangles: false,
            keeps_photo_size: false,
            from: None,
            step_limit: StepLimit::default(),
            whole: None,
        }
    }

    /// The size of photos whose longer side is `max_size`.
    fn photo_of(&self, max_size: Option<u32>) -> UVec2 {
        let longer = self.photo.max_element();
        let side = max_size.unwrap_or(longer).min(longer);
        (self.photo.as_dvec2() * f64::from(side) / f64::from(longer))
            .round()
            .as_uvec2()
            .max(UVec2::ONE)
    }

    /// Seconds to decode the photos and for the work after the last step, with photos of `photo`.
    fn decode_and_reserve_secs(&self, photo: UVec2) -> [f64; 2] {
        let [all, held_out] =
            [self.photos[0] + self.photos[1], self.photos[1]].map(|count| count as f64);
        let [full, small] = [self.photo, photo].map(|size| size.as_dvec2().element_product());
        [all * full * DECODE_SECS, held_out * small * EVALUATE_SECS].map(|secs| secs * self.speed)
    }

    /// Options of a run of `steps`, and the seconds up to its last step.
    fn run(&self, steps: u64, photo: UVec2) -> (TrainOptions, f64) {
        let max_triangles = self.triangles(photo, steps);
        let options =
            TrainOptions { steps, max_triangles, milestones: [0; 4], ..self.options.clone() };
        let secs: f64 = part_secs(&options, photo, max_triangles).iter().sum();
        (options, secs * self.speed + self.decode_and_reserve_secs(photo)[0])
    }

    /// Maximum number of triangles of a run of `steps`.
    fn triangles(&self, photo: UVec2, steps: u64) -> u64 {
        if self.keeps_max_triangles {
            return self.options.max_triangles;
        }
        let [min, max] = TRIANGLES;
        let pixels = self.photos[0] as f64 * photo.as_dvec2().element_product();
        let max_of_photos = (pixels / PIXELS_PER_TRIANGLE).clamp(min, max);
        let triangles =
            (TRIANGLES_PER_STEP * steps as f64).clamp(min, max_of_photos).round() as u64;
        triangles.max(self.from.unwrap_or(0))
    }

    /// The plan for photos of one size; `None` if the budget is too small for it.
    fn for_size(&self, max_size: Option<u32>) -> Option<Plan> {
        let photo = self.photo_of(max_size);
        let reserve_secs = self.decode_and_reserve_secs(photo)[1];
        let left = self.budget.seconds.0 - self.spent_secs - reserve_secs;
        // Seconds rise with the steps: bisection finds the largest number that fits.
        let fits = |steps: u64| self.run(steps, photo).1 <= left;
        let mut low = FEWEST_STEPS;
        let mut high = 2 * FEWEST_STEPS;
        if !fits(low) {
            return None;
        }
        let max_steps = self.step_limit.steps.unwrap_or(1 << 40).max(FEWEST_STEPS);
        while fits(high) && high < max_steps {
            low = high;
            high *= 2;
        }
        while high - low > 1 {
            let middle = low + (high - low) / 2;
            *(if fits(middle) { &mut low } else { &mut high }) = middle;
        }
        let (TrainOptions { steps, max_triangles, .. }, step_secs) =
            self.run(low.min(max_steps), photo);
        Some(Plan { steps, max_triangles, max_size, step_secs, reserve_secs })
    }

    /// The plan, and the size of its largest photo, px.
    ///
    /// # Errors
    ///
    /// A budget too small for any scene.
    pub(super) fn plan(&self) -> Result<(Plan, UVec2)> {
        let enough_steps =
            self.step_limit.steps_of_full_photos.min(self.step_limit.steps.unwrap_or(u64::MAX));
        let mut size = None;
        loop {
            let photo = self.photo_of(size);
            let plan = self.for_size(size);
            let smaller = (photo.max_element() * 3 / 4).max(SMALLEST_PHOTO);
            let is_enough = plan.as_ref().is_some_and(|plan| plan.steps >= enough_steps);
            if is_enough || self.keeps_photo_size || smaller >= photo.max_element() {
                return plan.map(|plan| (plan, photo)).ok_or_else(|| self.too_small(photo));
            }
            size = Some(smaller);
        }
    }

    fn too_small(&self, photo: UVec2) -> Error {
        let needed = self.spent_secs
            + self.decode_and_reserve_secs(photo)[1]
            + self.run(FEWEST_STEPS, photo).1;
        let itself = WholeBudget { seconds: self.budget.seconds, scale: 1.0, offset: 0.0 };
        let WholeBudget { seconds, scale, offset } = self.whole.unwrap_or(itself);
        let needed = 1.2 * (scale * needed + offset);
        let parts = if needed < 1.0 { 10.0 } else { 1.0 };
        let needed = (parts * needed).ceil() / parts;
        Error::invalid(
            self.budget.option(),
            seconds,
            format!("{needed}s or more for this data set"),
        )
    }
}
