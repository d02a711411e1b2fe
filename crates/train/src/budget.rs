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

mod cost;
mod pace;
mod plan;

pub use cost::part_secs;
pub(crate) use cost::step_secs;
pub use pace::{BudgetControl, BudgetDetails, Correction, Pace, plan};
pub use plan::{Plan, PlanInput, StepLimit, WholeBudget};
pub use trisplat_scene::{Budget, BudgetClock, Seconds, Spending};
