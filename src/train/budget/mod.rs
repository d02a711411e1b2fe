//! Seconds put to work: how many steps, triangles and pixels a budget of time is best spent on, and a run that ends when it is.
//!
//! ```text
//! calibrate ──► plan ──► run: at each milestone pace ──► steps that are left
//!     └── cost ──┴──────────────────────────────┘
//! ```
//!
//! Timings choose numbers and nothing else: the same numbers without a budget are the same run, to the bit. `pace` may change how
//! many steps follow at a [milestone](super::timeline), and only there, so that the run that was made can be written down.

mod calibrate;
mod cost;
mod pace;
mod plan;

pub use crate::budget::{Budget, BudgetClock, Seconds, Spending};
pub use calibrate::calibrate;
pub use cost::{Calibration, CostModel, Workload, part_secs};
pub use pace::{BudgetDetails, Correction, Pace, Paced};
pub use plan::{Enough, Plan, PlanInput, plan};
