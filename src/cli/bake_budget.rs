//! `trisplat bake --budget`: what is spent, what was chosen, and how to do it again.

use super::bake_args::BakeArgs;
use crate::bake::pace::{BakeBudgetDetails, BakePace};
use crate::budget::{Budget, BudgetClock, Spending};
use crate::report::{StageDetails, StageReport, to_json};
use std::time::Instant;

/// What keeps the bake to the budget that was given, if one was; `began`: when the process did.
pub(super) fn pace(args: &BakeArgs, began: Instant) -> BakePace {
    match args.budget {
        Some(seconds) => BakePace::new(Budget::cpu(seconds), Spending::of_process(BudgetClock::Cpu, began)),
        None => BakePace::default(),
    }
}

/// The entry of the budget in the report, when all is written; `None` without a budget.
pub(super) fn stage(pace: &BakePace) -> Option<StageReport> {
    if !pace.is_limited() {
        return None;
    }
    let details = pace.details();
    let why = "nothing is soft: there is nothing to choose";
    Some(StageReport {
        name: BakeBudgetDetails::STAGE.to_owned(),
        seconds: 0.0,
        before: Default::default(),
        after: Default::default(),
        unneeded: details.is_none().then(|| why.to_owned()),
        details: details.as_ref().map(to_json).unwrap_or_default(),
    })
}

/// What is printed of it: what was left out and why, what was spent, and the options that repeat it.
pub(super) fn lines(pace: &BakePace) -> Vec<String> {
    let Some(details) = pace.details() else { return Vec::new() };
    let (Some(budget), Some(spent)) = (details.budget, details.spent_secs) else { return Vec::new() };
    let repeat = match &details.repeat {
        Some(options) => format!("the same file without it: {options}"),
        None => "everything was done, as without it".to_owned(),
    };
    let mut lines = details.reasons;
    lines.push(format!("spent {spent:.2}s of the budget {budget}; {repeat}"));
    lines
}

/// A warning when more was spent than there was.
pub(super) fn warning(args: &BakeArgs, pace: &BakePace) -> Option<String> {
    let (budget, spent) = (args.budget?, pace.spent_secs());
    // Clocks tick.
    (spent > 1.05 * budget.0).then(|| {
        let left_out = match pace.details().and_then(|details| details.repeat) {
            Some(_) => "what can be left out was, and",
            None => "nothing could be left out:",
        };
        format!("the bake took {spent:.2}s of CPU time, more than `budget` {budget}: {left_out} the rest takes that long")
    })
}
