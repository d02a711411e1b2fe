//! A bake with a time budget: time spent and choices made.

use crate::bake::pace::{BakeBudgetDetails, BakePace};
use crate::budget::{Budget, Spending};
use crate::report::{StageDetails, StageReport, to_json};
use std::time::Instant;

/// The pace of a bake with a budget; `began`: start of the clock.
pub(super) fn pace(budget: Option<Budget>, began: Instant) -> BakePace {
    match budget {
        Some(budget) => BakePace::new(budget, Spending::of_process(budget.clock, began)),
        None => BakePace::default(),
    }
}

/// The report's budget entry, after all files are written; `None` without a budget.
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

/// A warning when the bake exceeded its budget.
pub(super) fn warning(budget: Option<Budget>, pace: &BakePace) -> Option<String> {
    let (budget, spent) = (budget?.seconds, pace.spent_secs());
    // Tolerance for the clock's resolution.
    (spent > 1.05 * budget.0).then(|| {
        let left_out = match pace.details().and_then(|details| details.repeat) {
            Some(_) => "what can be left out was, and",
            None => "nothing could be left out:",
        };
        format!("the bake took {spent:.2}s of CPU time, more than `budget` {budget}: {left_out} the rest takes that long")
    })
}
