//! The command line. Thin: options and work live in the library, this folder parses and prints.
//!
//! Exit codes: 0 done, 1 failed (one error on stderr), 2 wrong usage, 130 stopped with Ctrl-C, 143
//! with SIGTERM, 129 with SIGHUP, 131 with SIGQUIT.

pub mod bake;
pub mod capture;
pub mod eval;
pub mod flags;
pub mod info;
pub mod inputs;
pub mod make;
pub mod mesh;
pub mod messages;
mod outputs;
mod pace;
pub mod plan;
pub mod program;
pub mod progress;
pub mod render;
pub mod schema;
mod signals;
mod suggestions;
mod terminal;
pub mod train;
pub mod train_args;
pub mod train_progress;
#[cfg(feature = "view")]
mod train_view;
#[cfg(feature = "view")]
pub mod view;

pub use flags::GlobalArgs;
pub use program::main;
