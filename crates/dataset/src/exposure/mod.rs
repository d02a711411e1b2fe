//! How photos differ in exposure, white balance, and falloff towards the corners.

mod correction;
mod solve;

pub(crate) use correction::SPREAD;
pub use correction::{ExposureUse, Exposures, Solved, Verdict, compared_size, judge};
pub use solve::{Cells, solve};
pub(crate) use solve::{Observation, spread_of_points};
