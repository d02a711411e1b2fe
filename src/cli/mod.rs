//! The command line. Thin: options and work live in the library, this folder parses and prints.
//!
//! Exit codes: 0 done, 1 failed (one error on stderr), 2 wrong usage, 130 stopped with Ctrl-C, 143 with SIGTERM, 129 with
//! SIGHUP, 131 with SIGQUIT.

pub mod bake;
pub mod bake_args;
mod bake_bytes;
mod bake_city;
pub mod capture;
mod capture_rows;
mod counts;
pub mod eval;
pub mod files;
pub mod flags;
pub mod generated;
pub mod global;
mod harden;
pub mod info;
pub mod info_dataset;
pub mod inputs;
pub mod layers;
pub mod make;
pub mod merge;
pub mod mesh;
pub mod messages;
#[cfg(not(feature = "view"))]
pub mod missing;
mod numbers;
mod out_of_memory;
mod outputs;
mod panics;
mod pictures;
pub mod plan;
pub mod program;
pub mod progress;
pub mod render;
mod resume;
pub mod schema;
mod settings_hint;
mod short_help;
mod signals;
mod suggestions;
pub mod teacher_args;
mod terminal;
pub mod train;
pub mod train_args;
mod train_block;
mod train_curve;
pub mod train_progress;
#[cfg(feature = "view")]
mod train_view;
pub mod validate;
mod version;
#[cfg(feature = "view")]
pub mod view;

pub use global::Global;
pub use program::main;
