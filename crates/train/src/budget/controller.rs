//! Keeps a run to its budget: at each milestone the number of remaining steps is chosen anew, from the
//! measured cost.

use super::cost::{CostModel, StepLoad, Workload, part_secs};
use super::plan::{Plan, PlanInput};
use crate::options::TrainOptions;
use crate::schedule::Schedule;
use crate::timeline::MILESTONES;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::{Budget, Seconds, Spending};

/// Most remaining steps, as a multiple of the planned ones.
const MOST_STRETCH: f64 = 10.0;

/// The known costs of a run with a budget; stored in its checkpoints.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BudgetController {
    /// The budget.
    pub budget: Budget,
    /// What was chosen before the first step.
    pub plan: Plan,
    /// The changes since.
    pub corrections: Vec<Correction>,
    model: CostModel,
    workload: Workload,
    /// Seconds spent at the start of the present part, and when its state was last stored.
    began_secs: f64,
    stored_secs: f64,
    /// Seconds predicted for the steps of the present part, with their real numbers of triangles.
    modelled_secs: f64,
    /// Seconds of the present part apart from its steps: the first one decodes photos.
    decoding_secs: f64,
    /// More steps than this gain nothing.
    #[serde(default)]
    most_steps: Option<u64>,
}

/// A pace, and the clock of the budget.
#[derive(Debug, Clone)]
pub struct Paced {
    /// The known costs.
    pub pace: BudgetController,
    /// What is spent.
    pub spending: Spending,
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

/// How a run used its budget.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BudgetDetails {
    /// The budget.
    pub budget: Budget,
    /// What was chosen before the first step.
    pub plan: Plan,
    /// The changes since.
    pub corrections: Vec<Correction>,
    /// Seconds spent at the time of the report.
    pub spent_secs: f64,
    /// Options that make the same run without a budget.
    pub repeat: String,
}

impl BudgetController {
    /// Of a run that begins after `spent_secs` of its budget.
    pub fn new(input: &PlanInput<'_>, plan: &Plan, spent_secs: f64) -> Self {
        let options = plan.apply(input.options);
        let triangles = input.calibration.triangles.min(plan.max_triangles);
        let workload = Workload::at_start(input.photo_of(plan.max_size), triangles);
        let model = input.calibration.model;
        let steps: f64 = part_secs(&model, &workload, &options).iter().sum();
        Self {
            budget: input.budget,
            plan: plan.clone(),
            corrections: Vec::new(),
            model,
            workload,
            began_secs: spent_secs,
            stored_secs: spent_secs,
            modelled_secs: 0.0,
            decoding_secs: (plan.step_secs - steps).max(0.0),
            most_steps: input.enough.steps,
        }
    }

    /// Counts step `step` (from 0), made with `triangles`. The real number replaces the forecast, so fewer
    /// triangles are not taken for a faster machine.
    pub fn stepped(&mut self, step: u64, triangles: u64, options: &TrainOptions) {
        let load = StepLoad::of_step(options, step, self.workload.photo, triangles as f64);
        self.modelled_secs += self.model.step_secs(&load);
    }

    /// After `step` steps and `spent_secs`: the options of the rest of the run, if this is a milestone.
    /// Earlier steps keep theirs.
    pub fn corrected(
        &mut self,
        step: u64,
        spent_secs: f64,
        triangles: u64,
        options: &TrainOptions,
    ) -> Option<TrainOptions> {
        let part = options.milestones.iter().position(|milestone| *milestone == step)?;
        self.learn(part, spent_secs, options);
        let position = MILESTONES[part];
        // Photos become larger during the run, and the scene then grows faster. So the limit on steps is
        // certain only after the last milestone.
        let growth =
            (part + 1 == MILESTONES.len()).then(|| self.workload.growth_to(triangles, position, options));
        self.workload = Workload { triangles, position, growth, ..self.workload };
        let left = self.budget.seconds.0 - self.plan.reserve_secs - spent_secs;
        let expected: f64 = part_secs(&self.model, &self.workload, options).iter().sum();
        let stretch = (left / expected.max(1e-9)).clamp(0.0, self.most_stretch(step, options));
        let corrected = stretched(options, part, stretch);
        (self.began_secs, self.modelled_secs, self.decoding_secs) = (spent_secs, 0.0, 0.0);
        self.corrections.push(Correction { step, spent_secs, steps: corrected.steps });
        Some(corrected)
    }

    /// Largest factor for the number of steps after `step`.
    fn most_stretch(&self, step: u64, options: &TrainOptions) -> f64 {
        let left = |steps: u64| steps.saturating_sub(step) as f64;
        let most = self.most_steps.map_or(f64::INFINITY, |most| left(most) / left(options.steps).max(1.0));
        most.min(MOST_STRETCH)
    }

    /// Updates the costs from the steps of a part.
    fn learn(&mut self, part: usize, spent_secs: f64, options: &TrainOptions) {
        let expected_secs = self.modelled_secs + self.decoding_secs;
        let ratio = (spent_secs - self.began_secs) / expected_secs.max(1e-9);
        if !(ratio.is_finite() && ratio > 0.0) {
            return;
        }
        let [soft, engine] = &mut self.model.scale;
        let last = options.milestones[part].saturating_sub(1);
        match Schedule::new(options).is_engine_shaded(last) {
            true => *engine *= ratio,
            // Steps with engine shading probably deviate like soft ones.
            false => (*soft, *engine) = (*soft * ratio, *engine * ratio),
        }
    }

    /// The state for a checkpoint after `spent_secs`.
    pub fn stored(&self, spent_secs: f64) -> Self {
        Self { stored_secs: spent_secs, ..self.clone() }
    }

    /// Seconds that were spent when this was stored.
    pub fn stored_secs(&self) -> f64 {
        self.stored_secs
    }

    /// Continues in another process after `spent_secs`. The time of reading everything again is not counted
    /// as steps.
    pub fn resume(&mut self, spent_secs: f64) {
        self.began_secs += spent_secs - self.stored_secs;
        self.stored_secs = spent_secs;
    }

    /// The use of the budget. `repeat` are the options that make the same run without it.
    pub fn details(&self, spent_secs: f64, repeat: String) -> BudgetDetails {
        let (plan, corrections) = (self.plan.clone(), self.corrections.clone());
        BudgetDetails { budget: self.budget, plan, corrections, spent_secs, repeat }
    }

    /// True when the run has all useful steps, and the budget has time for more.
    pub fn is_enough(&self) -> bool {
        self.most_steps.is_some_and(|most| self.plan.steps >= most)
    }

    /// "budget 60s of CPU time: 1500 steps, 21,000 triangles at most, photos as they are; ..." for the terminal.
    pub fn summary(&self) -> String {
        let Plan { steps, max_triangles, max_size, step_secs, reserve_secs } = &self.plan;
        let photos = max_size.map_or_else(
            || "photos as they are".to_owned(),
            |px| format!("photos of {px} px, because larger ones leave too few steps"),
        );
        // Hundredths of seconds say nothing beside ten.
        let shown =
            |secs: f64| Seconds(if secs < 10.0 { (100.0 * secs).round() / 100.0 } else { secs.round() });
        let (steps_take, rest) = (shown(*step_secs), shown(*reserve_secs));
        let budget = Budget { seconds: shown(self.budget.seconds.0), ..self.budget };
        format!(
            "budget {budget}: {steps} steps of at most {max_triangles} triangles, {photos}; steps should take {steps_take}, what \
             follows {rest}"
        )
    }
}

/// `options` with `stretch` times the steps of each part after milestone `part`, one at least.
fn stretched(options: &TrainOptions, part: usize, stretch: f64) -> TrainOptions {
    let [a, b, c, d] = options.milestones;
    let before = [a, b, c, d, options.steps];
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
    use crate::budget::cost::Calibration;
    use crate::budget::plan::{StepLimit, plan};
    use crate::timeline::Timeline;
    use glam::UVec2;

    fn input(options: &TrainOptions, seconds: f64) -> PlanInput<'_> {
        PlanInput {
            options,
            budget: Budget::cpu(Seconds(seconds)),
            spent_secs: 0.5,
            calibration: Calibration {
                model: CostModel::FITTED,
                triangles: 10_000,
                decode_secs: 0.01,
                evaluate_secs: 0.05,
            },
            photos: 40,
            held_out: 6,
            photo: PHOTO,
            triangles_given: false,
            size_given: false,
            from_scene: false,
            enough: StepLimit::default(),
        }
    }

    const PHOTO: UVec2 = UVec2::new(480, 270);

    /// Runs a plan on a machine with the costs `actual` and a scene of `triangles(position, most)` triangles;
    /// returns the seconds spent, the final options and the pace.
    fn run(
        seconds: f64,
        actual: CostModel,
        triangles: impl Fn(f64, u64) -> u64,
        resume_at: Option<usize>,
    ) -> (f64, TrainOptions, BudgetController) {
        let base = TrainOptions::default();
        let input = input(&base, seconds);
        let plan = plan(&input).unwrap();
        let (mut options, mut spent) = (plan.apply(&base), input.spent_secs);
        let triangles = |position: f64| triangles(position, plan.max_triangles);
        let mut pace = BudgetController::new(&input, &plan, spent);
        spent += pace.decoding_secs;
        let mut step = 0;
        for part in 0..5 {
            if resume_at == Some(part) {
                pace = pace.stored(spent);
                // The scene and the photos are read again.
                spent += 3.0;
                pace.resume(spent);
            }
            let end = options.milestones.get(part).copied().unwrap_or(options.steps);
            for now in step..end {
                let triangles = triangles(Timeline::new(&options).position(now));
                let load = StepLoad::of_step(&options, now, PHOTO, triangles as f64);
                spent += actual.step_secs(&load);
                pace.stepped(now, triangles, &options);
            }
            step = end;
            if let Some(milestone) = MILESTONES.get(part) {
                options = pace.corrected(step, spent, triangles(*milestone), &options).unwrap();
                options.validate().unwrap();
            }
        }
        (spent + plan.reserve_secs, options, pace)
    }

    /// A scene that is full early.
    fn full(position: f64, most: u64) -> u64 {
        if position < 6000.0 { most.min(10_000) } else { most }
    }

    #[test]
    fn plans_fill_the_budget_they_are_made_for() {
        let base = TrainOptions::default();
        let mut before = 0;
        for seconds in [20.0, 60.0, 300.0] {
            let plan = plan(&input(&base, seconds)).unwrap();
            let total = 0.5 + plan.step_secs + plan.reserve_secs;
            assert!(total <= seconds && total > 0.97 * seconds, "{total} of {seconds}");
            assert!(plan.steps > before);
            before = plan.steps;
        }
    }

    #[test]
    fn seconds_are_told_as_a_person_would() {
        let base = TrainOptions::default();
        // `make` gives training 85% of its 90 s, and the rest to the bake.
        let told = |seconds: f64| {
            let input = input(&base, seconds);
            BudgetController::new(&input, &plan(&input).unwrap(), 0.5).summary()
        };
        assert!(told(76.63).starts_with("budget 77s of CPU time: "), "{}", told(76.63));
        assert!(told(8.25).starts_with("budget 8.25s of CPU time: "), "{}", told(8.25));
        let input = input(&base, 5.0);
        let planned = Plan { reserve_secs: 0.005_210_000_000_000_076, ..plan(&input).unwrap() };
        let said = BudgetController::new(&input, &planned, 0.5).summary();
        assert!(said.ends_with("what follows 0.01s"), "{said}");
    }

    #[test]
    fn a_run_ends_with_its_budget_on_a_machine_that_is_not_as_measured() {
        for scale in [[1.0, 1.0], [0.5, 0.6], [1.6, 1.2], [1.0, 2.0]] {
            let (spent, options, _) = run(60.0, CostModel { scale }, full, None);
            assert!((spent / 60.0 - 1.0).abs() < 0.05, "{scale:?}: {spent}");
            assert!(options.milestones.is_sorted() && options.milestones[3] < options.steps);
        }
    }

    #[test]
    fn a_scene_that_stays_small_is_not_taken_for_a_fast_machine() {
        // An hour for a scene that never reaches a quarter of its limit of triangles.
        let (spent, options, pace) = run(3600.0, CostModel::FITTED, |_, most| most / 4, None);
        for scale in pace.model.scale {
            assert!((scale - 1.0).abs() < 1e-6, "{scale}");
        }
        assert!((spent / 3600.0 - 1.0).abs() < 0.05, "{spent}");
        // No part of the schedule gets all the saved time.
        let plain = Timeline::proportional(options.steps);
        for (made, plain) in options.milestones.iter().zip(plain) {
            assert!((*made as f64 / plain as f64 - 1.0).abs() < 0.5, "{:?}, {plain:?}", options.milestones);
        }
    }

    #[test]
    fn a_run_that_has_all_steps_that_pay_leaves_the_rest_of_its_budget() {
        let base = TrainOptions::default();
        let input = PlanInput {
            enough: StepLimit { steps: Some(1500), ..StepLimit::default() },
            ..input(&base, 600.0)
        };
        let plan = plan(&input).unwrap();
        assert_eq!((plan.steps, plan.max_triangles), (1500, 21_000));
        let mut pace = BudgetController::new(&input, &plan, 0.5);
        let mut options = plan.apply(&base);
        for part in 0..4 {
            let step = options.milestones[part];
            options = pace.corrected(step, 1.0, 9000, &options).unwrap();
            assert!(options.steps.abs_diff(1500) <= 2, "{}", options.steps);
        }
    }

    #[test]
    fn a_resumed_run_has_what_is_left() {
        let (spent, ..) = run(60.0, CostModel { scale: [1.1, 1.1] }, full, Some(2));
        assert!((spent / 60.0 - 1.0).abs() < 0.05, "{spent}");
    }

    #[test]
    fn a_run_too_slow_for_its_budget_still_passes_every_part() {
        let (_, options, _) = run(20.0, CostModel { scale: [40.0, 40.0] }, full, None);
        let [a, b, c, d] = options.milestones;
        assert!([b - a, c - b, d - c, options.steps - d].iter().all(|steps| *steps >= 1));
        let schedule = Schedule::new(&options);
        assert!(schedule.is_opaque(options.steps - 1) && !schedule.is_opaque(0));
    }

    #[test]
    fn what_is_given_is_kept() {
        let options = TrainOptions { max_triangles: 7000, ..TrainOptions::default() };
        let given = PlanInput { triangles_given: true, ..input(&options, 60.0) };
        assert_eq!(plan(&given).unwrap().max_triangles, 7000);
        let large = PlanInput { photo: UVec2::new(6000, 4000), ..input(&options, 30.0) };
        assert!(plan(&large).unwrap().max_size.is_some());
        assert_eq!(plan(&PlanInput { size_given: true, ..large.clone() }).map_or(None, |p| p.max_size), None);
    }

    #[test]
    fn a_budget_too_small_for_anything_is_an_error() {
        let options = TrainOptions::default();
        let error = plan(&input(&options, 0.6)).unwrap_err().to_string();
        assert!(error.starts_with("budget is 0.6s: expected ") && error.contains("or more"), "{error}");
    }

    #[test]
    fn steps_between_milestones_change_nothing() {
        let base = TrainOptions::default();
        let input = input(&base, 60.0);
        let plan = plan(&input).unwrap();
        let options = plan.apply(&base);
        assert_eq!(options.milestones, Timeline::proportional(plan.steps));
        let mut pace = BudgetController::new(&input, &plan, 0.5);
        assert_eq!(pace.corrected(options.milestones[0] - 1, 5.0, 9000, &options), None);
        assert!(pace.corrections.is_empty());
    }
}
