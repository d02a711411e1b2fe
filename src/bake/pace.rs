//! Keeps the bake of a soft scene to a budget: what it spends its time on, pictures of the scene, rounds of fitting and colours, is chosen by what the
//! first of them cost, and chosen anew after each.
//!
//! Timings choose numbers and nothing else: options with the same numbers make the same file without a budget, to the bit. Everything else
//! a bake does is done as asked, whatever is left.

mod plan;

pub use plan::{PaceInput, PacePlan, PictureCosts, plan};

use crate::budget::{Budget, Spending};
use crate::report::StageDetails;
use plan::{FEWEST_PICTURES, color_secs, evaluation_secs, round_secs, rounds, whole_rounds};

/// Seconds per triangle that follow the colours: vertices, chunks, order, writing.
const TAIL_SECS: f64 = 0.8e-6;

/// The part of a budget that rounds of fitting leave over, and ...
const MARGIN: f64 = 0.03;
/// ... that pictures leave over: the stages between them and their colours are not timed.
const PICTURES_MARGIN: f64 = 0.1;
/// By this part of the budget colours may overspend it: they are what pictures were drawn for.
const OVERSPENT: f64 = 0.05;

/// Keeps a bake to a budget; the default has none and never stands in the way.
#[derive(Debug, Clone, Default)]
pub struct BakePace {
    limit: Option<(Budget, Spending)>,
    /// A soft scene was met: there is something to choose.
    began: bool,
    asked: PaceWork,
    costs: PictureCosts,
    chosen: BakeBudgetDetails,
    /// Options that make the same choices.
    repeat: Vec<String>,
}

/// What is asked for when there is time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct PaceWork {
    /// Triangles of the scene.
    pub(super) triangles: usize,
    /// Cameras that the stages before fitting draw, to see what is hidden.
    pub(super) watching: usize,
    /// Rounds of fitting.
    pub(super) rounds: u32,
    /// Passes over the pictures for colours; 0: colours stay.
    pub(super) color_passes: u32,
}

/// What was chosen to keep a bake to its budget, and why.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct BakeBudgetDetails {
    /// The budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<Budget>,
    /// Seconds spent of it when the report was made.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spent_secs: Option<f64>,
    /// Pictures drawn of the soft scene; 0 when there was no time for any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pictures: Option<u64>,
    /// Rounds of fitting; 0 when there was no time for any.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounds: Option<u32>,
    /// Whether there was time to fit colours.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub colors: Option<bool>,
    /// Why less was done than without a budget, one sentence each. Options are named by their fields, in backticks.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub reasons: Vec<String>,
    /// Options that make the same file without a budget; empty when everything was done.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub repeat: Option<String>,
}

impl StageDetails for BakeBudgetDetails {
    const STAGE: &'static str = "budget";
}

impl BakePace {
    /// A pace that keeps to `budget`; `spending` measures what is spent.
    pub fn new(budget: Budget, spending: Spending) -> Self {
        Self { limit: Some((budget, spending)), ..Self::default() }
    }

    /// Whether there is a budget.
    pub fn is_limited(&self) -> bool {
        self.limit.is_some()
    }

    /// Seconds spent so far; 0 without a budget.
    pub fn spent_secs(&self) -> f64 {
        self.limit.map_or(0.0, |(_, spending)| spending.seconds())
    }

    /// What was chosen so far; `None` if there was no budget, or nothing to choose because no scene was soft.
    pub fn details(&self) -> Option<BakeBudgetDetails> {
        let (budget, spending) = self.limit.filter(|_| self.began)?;
        let repeat = self.repeat.join(" ");
        Some(BakeBudgetDetails {
            budget: Some(budget),
            spent_secs: Some(spending.seconds()),
            repeat: Some(repeat).filter(|options| !options.is_empty()),
            ..self.chosen.clone()
        })
    }

    /// Begins with a soft scene, for which this was asked.
    pub(super) fn begin(&mut self, asked: PaceWork) {
        (self.began, self.asked) = (true, asked);
    }

    /// Runs `work` and counts what it spends, seconds; 0 without a budget.
    pub(super) fn timed<T>(&self, work: impl FnOnce() -> T) -> (T, f64) {
        let before = self.spent_secs();
        let made = work();
        (made, self.spent_secs() - before)
    }

    /// The time of one solid picture; the first call sets it.
    pub(super) fn learn_solid(&mut self, secs: f64) {
        if self.costs.solid == 0.0 {
            self.costs.solid = secs;
        }
    }

    /// Whether there is time to search for viewpoints and draw from them, when the search takes so long.
    pub(super) fn affords_search(&mut self, secs: f64) -> bool {
        // What is drawn from them costs half as much or more.
        let affords = 1.5 * secs <= self.left_secs();
        if !affords {
            self.skip_pictures(format!("no pictures: finding where to look from takes up to {secs:.2} s"));
        }
        affords
    }

    /// Whether to draw another picture after `drawn` of `most`; the last took `secs`.
    pub(super) fn wants_picture(&mut self, drawn: usize, most: usize, secs: f64) -> bool {
        if drawn == 0 || drawn == most || !self.is_active() {
            self.chosen.pictures = Some(drawn as u64);
            return drawn < most;
        }
        // The first one allocates; after that all count alike.
        let mean = (self.costs.soft * (drawn - 1) as f64 + secs) / drawn as f64;
        self.costs.soft = if drawn == 2 { secs } else { mean };
        let PaceWork { rounds: most_rounds, color_passes, watching, .. } = self.asked;
        let costs = self.costs;
        let before_fitting = watching as f64 * costs.solid;
        let left_secs = self.left_secs() - self.part_secs(PICTURES_MARGIN) - before_fitting;
        let input = PaceInput { left_secs, costs, drawn, most_pictures: most, most_rounds, color_passes };
        self.chosen.pictures = Some(drawn as u64);
        match plan(&input) {
            Some(plan) if plan.pictures > drawn => return true,
            // What is drawn is of use even if it took longer than planned.
            found if found.is_some() || drawn >= FEWEST_PICTURES => {
                let why = format!(
                    "{drawn} of {most} pictures: one takes {:.3} s, and there must be time to use them",
                    costs.soft
                );
                self.because(why, format!("--set teacher_pictures={drawn}"));
            }
            _ => self
                .skip_pictures(format!("no pictures: one takes {secs:.3} s, and there is no time to use it")),
        }
        false
    }

    /// Whether no picture is to be used, because there is no time.
    pub(super) fn skips_pictures(&self) -> bool {
        self.is_active() && self.chosen.pictures == Some(0)
    }

    /// Rounds of fitting in all, at most `most`, when `done` are made and another takes `round_secs`; colours are to be fitted to `views` pictures.
    pub(super) fn rounds(&self, done: u32, round_secs: f64, most: u32, views: usize) -> u32 {
        let later =
            color_secs(views, self.asked.color_passes, &self.costs) + evaluation_secs(views, &self.costs);
        let left = self.left_secs() - self.part_secs(MARGIN) - later;
        match done {
            0 => rounds(left, round_secs, most),
            _ => done + whole_rounds(left, round_secs, most.saturating_sub(done)),
        }
    }

    /// Expected seconds of a round of fitting to `pictures`, before one was measured.
    pub(super) fn expected_round_secs(&self, pictures: usize) -> f64 {
        round_secs(pictures, &self.costs)
    }

    /// Records that `made` of `most` rounds of fitting are done; the last took `secs`.
    pub(super) fn fitted(&mut self, rounds: u32, most: u32, secs: f64) {
        self.chosen.rounds = Some(rounds);
        if rounds == 0 {
            self.because(
                format!("triangles not fitted: a round takes {secs:.2} s"),
                "--set reshape=off".to_owned(),
            );
        } else if rounds < most {
            let why = format!("{rounds} of {most} rounds of fitting: the last took {secs:.2} s");
            self.because(why, format!("--set reshape_rounds={rounds}"));
        }
    }

    /// Whether there is time to fit colours to `pictures`.
    pub(super) fn affords_colors(&mut self, views: usize) -> bool {
        let secs = color_secs(views, self.asked.color_passes, &self.costs);
        let affords = secs <= self.left_secs() + self.part_secs(OVERSPENT);
        self.chosen.colors = Some(affords);
        if !affords {
            self.because(format!("colours not fitted: that takes {secs:.2} s"), "--set refit=off".to_owned());
        }
        affords
    }

    /// Whether colours were not fitted because there was no time.
    pub(super) fn skips_colors(&self) -> bool {
        self.chosen.colors == Some(false)
    }

    /// Whether there is a budget, and something to choose.
    pub(super) fn is_active(&self) -> bool {
        self.began && self.is_limited()
    }

    /// Seconds left for what is chosen; infinitely many when nothing is.
    fn left_secs(&self) -> f64 {
        match self.limit.filter(|_| self.began) {
            Some((budget, spending)) => {
                budget.seconds.0 - spending.seconds() - TAIL_SECS * self.asked.triangles as f64
            }
            None => f64::INFINITY,
        }
    }

    /// So much of the budget, seconds.
    fn part_secs(&self, part: f64) -> f64 {
        self.limit.map_or(0.0, |(budget, _)| part * budget.seconds.0)
    }

    fn skip_pictures(&mut self, why: String) {
        self.chosen.pictures = Some(0);
        self.because(why, "--teacher off".to_owned());
    }

    fn because(&mut self, why: String, repeat: String) {
        self.chosen.reasons.push(why);
        self.repeat.push(repeat);
    }
}
