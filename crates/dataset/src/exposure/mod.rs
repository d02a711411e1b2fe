//! How photos differ in exposure, white balance, and falloff towards the corners.

mod correction;
pub(crate) mod points;
mod solve;

pub use correction::{ExposureUse, Exposures, Solved, Verdict, compared_size, judge};
pub use solve::{Cells, solve};
