//! Budgets of time: chooses steps, triangles and pixels for the given seconds, and makes the run end with
//! them.
//!
//! ```text
//! calibrate ──► plan ──► run: at each milestone pace ──► steps that are left
//!     └── cost ──┴──────────────────────────────┘
//! ```
//!
//! Timings choose only these numbers: the same numbers without a budget give the same run, bitwise. `pace`
//! may change the number of remaining steps only at a milestone (`timeline.rs`), so that options can
//! describe the run.

mod calibrate;
mod controller;
mod cost;
mod plan;

pub use calibrate::calibrate;
pub use controller::{BudgetController, BudgetDetails, Correction, Paced};
pub use cost::{Calibration, CostModel, Workload, part_secs};
pub use plan::{Plan, PlanInput, StepLimit, plan};
pub use trisplat_scene::{Budget, BudgetClock, Seconds, Spending};
