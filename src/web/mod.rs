//! The program for pages and scripts: one job, read from a file, per process.
//!
//! It is built for `wasm32-wasip1-threads` and run by `web/` in the repository, which gives it its files from
//! memory. The library does the work; this module has the job's types, and prints progress as lines of JSON.

#[cfg(target_arch = "wasm32")]
mod new;
mod run;

pub use run::main;
