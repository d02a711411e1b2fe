//! The program as a user meets it, whole runs through the library, files that are damaged, and
//! whatever the disk does.

mod cli;
mod faults;
mod flows;
mod mutants;
#[cfg(all(feature = "view", unix))]
mod window;
