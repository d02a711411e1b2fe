//! The program as a page or a script runs it: one job, read from a file, in a process that has nothing else to do.
//!
//! It is built for `wasm32-wasip1-threads` and run by `web/` in the repository, which gives it its files from memory. What it does
//! is what the library does; here are the job's shape, and lines of JSON on standard output that say how it goes.

mod job;
mod lines;
#[cfg(target_arch = "wasm32")]
mod new;
mod run;

pub use run::main;
