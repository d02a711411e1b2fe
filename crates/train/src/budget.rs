//! Budgets of time: some steps measure the machine, seconds choose steps, triangles and the size of
//! photos, and a clock moves milestones.
//!
//! ```text
//! speed ──► plan ──► run: at each milestone, seconds that are left ──► steps that are left
//! ```
//!
//! Timings choose only these numbers: the same numbers without a budget give the same run, bitwise.
//! The number of remaining steps changes only at a milestone (`timeline.rs`), so that options can
//! describe the run.

use crate::options::{REFERENCE_STEPS, TrainOptions};
use crate::pyramid::{MIN_PX, size_at};
use crate::schedule::Schedule;
use crate::timeline::{MILESTONES, Timeline};
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::Dataset;
use trisplat_dataset::exposure::ExposureUse;
use trisplat_scene::{Error, Result};

pub use trisplat_scene::{Budget, BudgetClock, Seconds, Spending};

/// Seconds of a step: a constant, per triangle and per pixel, soft and with engine shading. Only
/// their proportions count, because [`speed`](crate::measure_speed) measures the machine.
const STEP_SECS: [[f64; 3]; 2] = [[0.75e-3, 0.36e-6, 0.046e-6], [0.0, 0.53e-6, 0.1e-6]];
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
/// Share of the first part after which its steps are timed: before, the scene grows.
const TIMED_FROM: f64 = 0.9;
/// Maximum remaining steps, as a multiple of the planned ones.
const MAX_STRETCH: f64 = 10.0;

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

/// A change of the remaining steps.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Correction {
    /// Steps made.
    pub step: u64,
    /// Seconds of the budget spent.
    pub spent_secs: f64,
    /// Steps of the whole run from here on.
    pub steps: u64,
}

/// Use of a budget by a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BudgetDetails {
    /// The budget.
    pub budget: Budget,
    /// Choices before the first step.
    pub plan: Plan,
    /// The changes since.
    pub corrections: Vec<Correction>,
    /// Seconds spent at the time of the report.
    pub spent_secs: f64,
    /// Options that make the same run without a budget.
    pub repeat: String,
}

/// A run with a budget, as its checkpoints store it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pace {
    /// The budget.
    pub budget: Budget,
    /// Choices before the first step.
    pub plan: Plan,
    /// The changes since.
    pub corrections: Vec<Correction>,
    /// The size of the photos, the largest, px.
    photo: UVec2,
    /// Seconds spent at the start of the present part, and when this was last stored.
    began_secs: f64,
    pub(crate) stored_secs: f64,
    /// Seconds for the work after the last step, once they were measured.
    pub(crate) reserve_secs: Option<f64>,
    /// Steps beyond which the run gains nothing.
    #[serde(rename = "most_steps")]
    max_steps: Option<u64>,
}

/// A pace, and the clock of the budget.
#[derive(Debug, Clone)]
pub struct BudgetControl {
    /// The plan and its changes.
    pub pace: Pace,
    /// Clock of the spent time.
    pub spending: Spending,
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

/// Chooses steps, triangles and the size of photos. The rule: the most steps that fit, with
/// fourteen triangles per step, and unchanged photos unless that leaves too few steps.
///
/// # Errors
///
/// A budget too small for any scene.
pub fn plan(input: &PlanInput<'_>) -> Result<Pace> {
    let mut size = None;
    loop {
        let photo = input.photo_of(size);
        let plan = input.for_size(size);
        let smaller = (photo.max_element() * 3 / 4).max(SMALLEST_PHOTO);
        let enough = plan.as_ref().is_some_and(|plan| {
            plan.steps
                >= input
                    .step_limit
                    .steps_of_full_photos
                    .min(input.step_limit.steps.unwrap_or(u64::MAX))
        });
        if enough || input.keeps_photo_size || smaller >= photo.max_element() {
            let plan = plan.ok_or_else(|| input.too_small(photo))?;
            return Ok(Pace {
                budget: input.budget,
                plan,
                corrections: Vec::new(),
                photo,
                began_secs: input.spent_secs,
                stored_secs: input.spent_secs,
                reserve_secs: None,
                max_steps: input.step_limit.steps,
            });
        }
        size = Some(smaller);
    }
}

/// The run between milestones, with the steps of each part at its end.
fn ends(options: &TrainOptions) -> [u64; 5] {
    let [a, b, c, d] = match options.milestones {
        [0, 0, 0, 0] => Timeline::proportional(options.steps),
        milestones => milestones,
    };
    [a, b, c, d, options.steps]
}

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
pub(super) fn step_secs(is_opaque: bool, triangles: f64, pixels: f64) -> f64 {
    let [constant, per_triangle, per_pixel] = STEP_SECS[usize::from(is_opaque)];
    constant + per_triangle * triangles + per_pixel * pixels
}

impl Pace {
    /// Options of the rest of the run after `step` steps and `spent_secs`, if this is a milestone;
    /// earlier steps keep theirs.
    pub(crate) fn corrected(
        &mut self,
        step: u64,
        spent_secs: f64,
        triangles: u64,
        options: &TrainOptions,
    ) -> Option<TrainOptions> {
        if step == (TIMED_FROM * options.milestones[0] as f64) as u64 {
            self.began_secs = spent_secs;
        }
        let part = options.milestones.iter().position(|milestone| *milestone == step)?;
        let secs = part_secs(options, self.photo, triangles);
        let expected = match part {
            // Seconds of a scene with all its triangles.
            0 => (1.0 - TIMED_FROM) * part_secs(options, self.photo, 2 * triangles)[0],
            part => secs[part],
        };
        let speed = ((spent_secs - self.began_secs) / expected.max(1e-9)).max(1e-9);
        let reserve = self.reserve_secs.unwrap_or(speed * self.plan.reserve_secs);
        let left = self.budget.seconds.0 - spent_secs - reserve;
        let rest = speed * secs[part + 1..].iter().sum::<f64>();
        let to_do = |steps: u64| steps.saturating_sub(step) as f64;
        let max_stretch = self
            .max_steps
            .map_or(f64::INFINITY, |max_steps| to_do(max_steps) / to_do(options.steps).max(1.0));
        let stretch = (left / rest.max(1e-9)).clamp(0.0, max_stretch.min(MAX_STRETCH));
        let corrected = stretched(options, part, stretch);
        self.began_secs = spent_secs;
        self.corrections.push(Correction { step, spent_secs, steps: corrected.steps });
        Some(corrected)
    }

    /// Continues after `spent_secs`; the time since this was stored is not counted as steps.
    pub(crate) fn resume(&mut self, spent_secs: f64) {
        self.began_secs += spent_secs - self.stored_secs;
        self.stored_secs = spent_secs;
    }

    /// `options` with the choices of the plan. Milestones are explicit, because they may change.
    pub fn apply(&self, options: &TrainOptions) -> TrainOptions {
        let Plan { steps, max_triangles, .. } = self.plan;
        TrainOptions {
            steps,
            max_triangles,
            milestones: Timeline::proportional(steps),
            ..options.clone()
        }
    }

    /// The use of the budget by a run that ended with `options`.
    pub(crate) fn details(&self, spent_secs: f64, options: &TrainOptions) -> BudgetDetails {
        let TrainOptions { steps, max_triangles, milestones: [a, b, c, d], .. } = options;
        let size = self.plan.max_size.map_or(String::new(), |px| format!(" --max-size {px}"));
        // A repeat need not judge exposures again, and might come to other shares without a budget.
        let exposure = match options.exposure {
            ExposureUse::Auto | ExposureUse::On => String::new(),
            ExposureUse::Off => " --set exposure=off".to_owned(),
            ExposureUse::Shares([gain, balance, falloff]) => {
                format!(" --set \"exposure=[{gain},{balance},{falloff}]\"")
            }
        };
        let repeat = format!(
            "--steps {steps} --max-triangles {max_triangles}{size} --set \"milestones=[{a},{b},{c},{d}]\"{exposure}"
        );
        let plan = self.plan.clone();
        let corrections = self.corrections.clone();
        BudgetDetails { budget: self.budget, plan, corrections, spent_secs, repeat }
    }

    /// True when the run has all useful steps, and the budget has time for more.
    pub fn is_enough(&self) -> bool {
        self.max_steps.is_some_and(|max_steps| self.plan.steps >= max_steps)
    }

    /// "budget 60s of CPU time: 1500 steps of at most 21000 triangles, photos as they are; ..." for
    /// the terminal.
    pub fn summary(&self) -> String {
        let Plan { steps, max_triangles, max_size, .. } = &self.plan;
        let photos = max_size.map_or_else(
            || "photos as they are".to_owned(),
            |px| format!("photos of {px} px, because larger ones leave too few steps"),
        );
        // From ten seconds on, hundredths say nothing.
        let secs = self.budget.seconds.0;
        let seconds =
            Seconds(if secs < 10.0 { (100.0 * secs).round() / 100.0 } else { secs.round() });
        let budget = Budget { seconds, ..self.budget };
        format!(
            "budget {budget}: about {steps} steps of at most {max_triangles} triangles, {photos}"
        )
    }
}

/// `options` with `stretch` times the steps of each part after milestone `part`, one at least.
fn stretched(options: &TrainOptions, part: usize, stretch: f64) -> TrainOptions {
    let before = ends(options);
    let mut after = before;
    for next in part + 1..before.len() {
        let steps = (before[next] - before[next - 1]) as f64 * stretch;
        after[next] = after[next - 1] + (steps.round() as u64).max(1);
    }
    let [a, b, c, d, steps] = after;
    TrainOptions { steps, milestones: [a, b, c, d], ..options.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PHOTO: UVec2 = UVec2::new(480, 270);

    fn input(options: &TrainOptions, seconds: f64) -> PlanInput<'_> {
        PlanInput {
            options,
            budget: Budget::cpu(Seconds(seconds)),
            spent_secs: 0.5,
            speed: 1.0,
            photos: [40, 6],
            photo: PHOTO,
            keeps_max_triangles: false,
            keeps_photo_size: false,
            from: None,
            step_limit: StepLimit::default(),
            whole: None,
        }
    }

    /// Runs a plan on a machine that takes `soft` and `engine` times as long, with a scene of
    /// `triangles` of `most`; returns the seconds spent and the final options.
    fn run(
        seconds: f64,
        [soft, engine]: [f64; 2],
        triangles: impl Fn(u64) -> u64,
        resume_at: Option<usize>,
    ) -> (f64, TrainOptions) {
        let base = TrainOptions::default();
        let mut pace = plan(&input(&base, seconds)).unwrap();
        let triangles = triangles(pace.plan.max_triangles);
        let mut options = pace.apply(&base);
        let mut spent = 0.5;
        for part in 0..5 {
            if resume_at == Some(part) {
                // The scene and the photos are read again.
                spent += 3.0;
                pace.began_secs += 3.0;
            }
            let secs =
                part_secs(&options, PHOTO, triangles)[part] * if part < 2 { soft } else { engine };
            if part == 0 {
                // Grown in the last tenth.
                let last = 0.1 * part_secs(&options, PHOTO, 2 * triangles)[0] * soft;
                let grown = (TIMED_FROM * options.milestones[0] as f64) as u64;
                assert_eq!(pace.corrected(grown, spent + secs - last, triangles, &options), None);
            }
            spent += secs;
            if part < 4 {
                let step = options.milestones[part];
                options = pace.corrected(step, spent, triangles, &options).unwrap();
                options.validate().unwrap();
            }
        }
        (spent + pace.plan.reserve_secs * engine, options)
    }

    #[test]
    fn plans_fill_the_budget_they_are_made_for() {
        let base = TrainOptions::default();
        let mut before = 0;
        for seconds in [20.0, 60.0, 300.0] {
            let Plan { steps, step_secs, reserve_secs, .. } =
                plan(&input(&base, seconds)).unwrap().plan;
            let total = 0.5 + step_secs + reserve_secs;
            assert!(
                total <= seconds && total > 0.97 * seconds && steps > before,
                "{total} of {seconds}"
            );
            before = steps;
        }
    }

    #[test]
    fn seconds_are_told_as_a_person_would() {
        let base = TrainOptions::default();
        // `make` gives training 85% of its 90 s, and the rest to the bake.
        let told = |seconds: f64| plan(&input(&base, seconds)).unwrap().summary();
        assert!(told(76.63).starts_with("budget 77s of CPU time: "), "{}", told(76.63));
        assert!(told(8.25).starts_with("budget 8.25s of CPU time: "), "{}", told(8.25));
    }

    #[test]
    fn a_run_ends_with_its_budget_on_any_machine_and_after_a_stop() {
        for speed in [[1.0, 1.0], [0.5, 0.6], [1.6, 1.2], [1.0, 2.0]] {
            for (few, resume_at) in [(1, None), (4, Some(2))] {
                let (spent, options) = run(60.0, speed, |most| most / few, resume_at);
                assert!((spent / 60.0 - 1.0).abs() < 0.03, "{speed:?}: {spent}");
                assert!(options.milestones.is_sorted() && options.milestones[3] < options.steps);
            }
        }
    }

    #[test]
    fn budget_that_pays_no_more_is_left() {
        let base = TrainOptions::default();
        let step_limit = StepLimit { steps: Some(1500), ..StepLimit::default() };
        let mut pace = plan(&PlanInput { step_limit, ..input(&base, 600.0) }).unwrap();
        assert_eq!(
            (pace.plan.steps, pace.plan.max_triangles, pace.is_enough()),
            (1500, 21_000, true)
        );
        let mut options = pace.apply(&base);
        for part in 0..4 {
            let step = options.milestones[part];
            options = pace.corrected(step, 1.0 + 0.1 * part as f64, 9000, &options).unwrap();
            assert!(options.steps.abs_diff(1500) <= 2, "{}", options.steps);
        }
    }

    #[test]
    fn a_run_too_slow_for_its_budget_still_passes_every_part() {
        let (_, options) = run(20.0, [40.0, 40.0], |most| most, None);
        let [a, b, c, d] = options.milestones;
        assert!([b - a, c - b, d - c, options.steps - d].iter().all(|steps| *steps >= 1));
        let schedule = Schedule::new(&options);
        assert!(schedule.is_opaque(options.steps - 1) && !schedule.is_opaque(0));
    }

    #[test]
    fn what_is_given_is_kept() {
        let options = TrainOptions { max_triangles: 7000, ..TrainOptions::default() };
        let plan = |input: &PlanInput<'_>| plan(input).unwrap().plan;
        let given = PlanInput { keeps_max_triangles: true, ..input(&options, 60.0) };
        assert_eq!(plan(&given).max_triangles, 7000);
        assert_eq!(
            plan(&PlanInput { from: Some(90_000), ..input(&options, 60.0) }).max_triangles,
            90_000
        );
        let large = PlanInput { photo: UVec2::new(3000, 2000), ..input(&options, 60.0) };
        assert!(plan(&large).max_size.is_some());
        assert_eq!(plan(&PlanInput { keeps_photo_size: true, ..large }).max_size, None);
    }

    #[test]
    fn a_budget_too_small_for_anything_is_an_error() {
        let options = TrainOptions::default();
        let error = plan(&input(&options, 0.6)).unwrap_err().to_string();
        assert!(
            error.starts_with("budget is 0.6s: expected ") && error.contains("or more"),
            "{error}"
        );
    }

    #[test]
    fn budget_of_a_part_follows_its_steps_photos_and_shading() {
        let options = |steps| TrainOptions { steps, ..TrainOptions::default() };
        let plain = part_secs(&options(1000), PHOTO, 10_000);
        let longer = TrainOptions { milestones: [400, 667, 800, 1100], ..options(1200) };
        let longer = part_secs(&longer, PHOTO, 10_000);
        for (part, factor) in [(0, 1.0), (1, 1.0), (2, 1.0), (3, 3.0), (4, 1.0)] {
            assert!(
                (longer[part] / plain[part] / factor - 1.0).abs() < 0.01,
                "{part}: {plain:?} {longer:?}"
            );
        }
        let per_step: Vec<f64> =
            plain.iter().zip([400.0, 267.0, 133.0, 100.0, 100.0]).map(|(s, n)| s / n).collect();
        assert!(per_step.is_sorted(), "{per_step:?}");
        // Between milestones nothing changes.
        let base = TrainOptions::default();
        let mut pace = plan(&input(&base, 60.0)).unwrap();
        let options = pace.apply(&base);
        assert_eq!(pace.corrected(options.milestones[0] - 1, 5.0, 9000, &options), None);
    }
}
