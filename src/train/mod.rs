//! Photos to soup: the optimisation of Held et al. 2025.
//!
//! ```text
//! init ──► state ──► [ backend.step(photo, rates) … ] ──► refine ──► … ──► soup
//!                        schedule: rates, sizes, SH      watch: complete passes
//! ```

pub mod backend;
pub mod checkpoint;
pub mod clock;
pub mod cpu;
#[cfg(feature = "cli")]
pub mod curve;
pub mod eval;
pub mod init;
pub mod neighbours;
pub mod options;
pub mod params;
pub mod presets;
pub mod progress;
pub mod pyramid;
pub mod refine;
pub mod run;
mod samples;
pub mod schedule;
pub mod space;
pub mod trainer;
pub mod update;
pub mod watch;

pub use backend::Backend;
pub use options::{Preset, TrainOptions};
pub use run::{RunOptions, Trained, run};
pub use trainer::Trainer;
