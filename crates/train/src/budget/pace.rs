//! The pace of a run with a budget: its plan, and new numbers of steps at milestones.

use super::cost::{ends, part_secs};
use super::plan::{Plan, PlanInput};
use crate::options::TrainOptions;
use crate::timeline::Timeline;
use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::exposure::ExposureUse;
use trisplat_scene::{Budget, Result, Seconds, Spending};

/// Share of the first part after which its steps are timed: before, the scene grows.
const TIMED_FROM: f64 = 0.9;
/// Maximum remaining steps, as a multiple of the planned ones.
const MAX_STRETCH: f64 = 10.0;

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

/// Chooses steps, triangles and the size of photos. The rule: the most steps that fit, with
/// fourteen triangles per step, and unchanged photos unless that leaves too few steps.
///
/// # Errors
///
/// A budget too small for any scene.
pub fn plan(input: &PlanInput<'_>) -> Result<Pace> {
    let (plan, photo) = input.plan()?;
    Ok(Pace {
        budget: input.budget,
        plan,
        corrections: Vec::new(),
        photo,
        began_secs: input.spent_secs,
        stored_secs: input.spent_secs,
        reserve_secs: None,
        max_steps: input.step_limit.steps,
    })
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
    use crate::budget::plan::StepLimit;
    use crate::schedule::Schedule;

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
