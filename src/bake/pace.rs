//! Keeps the bake of a soft scene to a budget. The numbers of pictures and rounds of fitting, and whether
//! colours are fitted, follow from the cost of the first ones, and are chosen anew after each.
//!
//! Timings choose only these numbers: options with the same numbers make the same file without a budget,
//! bitwise. All other work of a bake is done in full, whatever time is left.

mod plan;

pub use plan::{PaceInput, PacePlan, PictureCosts, plan};

use crate::budget::{Budget, Spending};
use crate::report::StageDetails;
use plan::{FEWEST_PICTURES, color_secs, evaluation_secs, round_secs, rounds, whole_rounds};

/// Seconds per triangle of the work after the colours: vertices, chunks, order, writing.
const TAIL_SECS: f64 = 0.5e-6;
/// Seconds per triangle of the work between pictures and fitting: order, pruning, solid triangles.
const BETWEEN_SECS: f64 = 0.3e-6;

/// The share of a budget that rounds of fitting leave unused, and ...
const MARGIN: f64 = 0.03;
/// ... that pictures leave unused.
const PICTURES_MARGIN: f64 = 0.07;
/// Expected time of later pictures as a share of the first one's, before a second is timed.
const LATER_SHARE: f64 = 0.5;
/// The share of the budget that colours may overspend, because pictures without colours are useless.
const OVERSPENT: f64 = 0.05;

/// Keeps a bake to a budget; the default has none and limits nothing.
#[derive(Debug, Clone, Default)]
pub struct BakePace {
    limit: Option<(Budget, Spending)>,
    /// The scene is soft: there is something to choose.
    began: bool,
    asked: PaceWork,
    costs: PictureCosts,
    chosen: BakeBudgetDetails,
    /// Options that make the same choices.
    repeat: Vec<String>,
}

/// The options, to be followed if there is time.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct PaceWork {
    /// Triangles of the scene.
    pub(super) triangles: usize,
    /// Number of cameras that earlier stages draw to find hidden triangles.
    pub(super) watching: usize,
    /// Rounds of fitting.
    pub(super) rounds: u32,
    /// Passes over the pictures for colours; 0: colours stay.
    pub(super) color_passes: u32,
}

/// The choices that kept a bake to its budget, and their reasons.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
pub struct BakeBudgetDetails {
    /// The budget.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub budget: Option<Budget>,
    /// Seconds spent at the time of the report.
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

    /// The choices so far; `None` without a budget or without a soft scene.
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

    /// Begins with a soft scene and its options.
    pub(super) fn begin(&mut self, asked: PaceWork) {
        (self.began, self.asked) = (true, asked);
        self.costs.triangles = asked.triangles;
    }

    /// Runs `work` and measures its seconds; 0 without a budget.
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

    /// Whether there is time to search for viewpoints, in the given seconds, and to draw from them.
    pub(super) fn affords_search(&mut self, secs: f64) -> bool {
        // Drawing from them costs at least half as much.
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
        // The first one also allocates; after that all count equally.
        self.costs.soft = match drawn {
            1 => LATER_SHARE * secs,
            2 => secs,
            _ => (self.costs.soft * (drawn - 1) as f64 + secs) / drawn as f64,
        };
        let PaceWork { rounds: most_rounds, color_passes, watching, triangles } = self.asked;
        let costs = self.costs;
        let before_fitting = watching as f64 * costs.solid + BETWEEN_SECS * triangles as f64;
        let left_secs = self.left_secs() - self.part_secs(PICTURES_MARGIN) - before_fitting;
        let input = PaceInput { left_secs, costs, drawn, most_pictures: most, most_rounds, color_passes };
        self.chosen.pictures = Some(drawn as u64);
        match plan(&input) {
            Some(plan) if plan.pictures > drawn => return true,
            // Finished pictures are useful even if they took longer than planned.
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

    /// Whether there is no time to use any picture.
    pub(super) fn skips_pictures(&self) -> bool {
        self.is_active() && self.chosen.pictures == Some(0)
    }

    /// Total rounds of fitting, at most `most`, after `done` rounds; another takes `round_secs`. Colours will
    /// be fitted to `views` pictures.
    pub(super) fn rounds(&self, done: u32, round_secs: f64, most: u32, views: usize) -> u32 {
        let later =
            color_secs(views, self.asked.color_passes, &self.costs) + evaluation_secs(views, &self.costs);
        let left = self.left_secs() - self.part_secs(MARGIN) - later;
        match done {
            0 => rounds(left, round_secs, most),
            _ => done + whole_rounds(left, round_secs, most.saturating_sub(done)),
        }
    }

    /// Expected seconds of a round of fitting to `pictures`, before a round was measured.
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

    /// Seconds left for the work under control; infinite without a choice.
    fn left_secs(&self) -> f64 {
        match self.limit.filter(|_| self.began) {
            Some((budget, spending)) => {
                budget.seconds.0 - spending.seconds() - TAIL_SECS * self.asked.triangles as f64
            }
            None => f64::INFINITY,
        }
    }

    /// A share of the budget, seconds.
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
