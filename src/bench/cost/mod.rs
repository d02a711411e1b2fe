//! `trisplat bench cost`: seconds against error, for every option that trades one for the other.
//!
//! ```text
//! photos ──train──► solid soup ──bake──► file ──draw──► pictures
//!            └────► soft soup  ──bake──► file
//!                       └─────────draw (soft)────────► pictures
//! ```
//!
//! Each setting runs as a process of its own, one option away from the defaults (a few pairs: two). The settings of a
//! stage take turns, round by round, so that a machine that slows down slows all of them.

mod args;
mod bake_work;
mod base;
mod child;
mod draw;
mod draw_work;
mod front;
mod knobs;
mod page;
mod plot;
mod row;
mod run;
mod score;
mod setting;
mod sweep;
mod train_work;

pub use args::CostArgs;
pub use draw::{DrawArgs, draw};
pub use knobs::{CostInput, CostStage, KNOBS, Knob, KnobValue, PAIRS, Pair};
pub use row::{CostRow, MeasuredRow};
pub use run::{CostObserver, run};
