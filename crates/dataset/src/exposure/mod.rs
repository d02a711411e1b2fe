//! How photos differ in exposure, white balance, and falloff towards the corners.

mod correction;
mod solve;

pub use correction::{ExposureUse, Exposures, Solved, Verdict, compared_size, judge};
pub use solve::{Cells, solve};
pub(crate) use solve::{Observation, solve_points};
