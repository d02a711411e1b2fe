//! `trisplat bench cost`: where training stops to pay. A grid of steps and triangles on the user's photos, from short runs to those that take
//! a budget, each with several seeds; photos of the training set that are left out say how close each comes.

mod advice;
mod band;
mod cell;
mod grid;
mod run;

pub use advice::CostAdvice;
pub use cell::{CostCell, CostRun};
pub use run::{CostArgs, CostEvent, CostReport, run};
