//! The paper's formulas: pure functions, no buffers, no I/O.

pub mod adam;
pub mod loss;
