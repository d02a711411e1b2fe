//! `trisplat bench stress`: how exact the rasterisers and the files are when a scene is stretched, and where they break.
//!
//! ```text
//! seed ──► cases (axes) ──► scene ──► soft, solid (f32) ──┐
//!                             └─────► exact (f64) ────────┴──► errors ──► rows, worst cases ──► promises
//! ```

pub mod axes;
mod baked;
pub mod case;
mod climb;
pub mod exact;
pub mod exact_grad;
mod histogram;
mod invariances;
pub mod promises;
mod rate;
pub mod ray_caster;
mod rig;
mod rows;
mod run;
pub mod scene;
mod stored;
mod tally;

pub use rows::{ErrorSummary, InvarianceRow, Part, PromiseResult, StressReport, StressRow};
pub use run::{StressArgs, broken, replay, run};
