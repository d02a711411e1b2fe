//! Photos to soup: the optimisation of Held et al. 2025.

pub mod checkpoint;
pub mod curve;
pub mod init;
pub mod neighbours;
pub mod options;
pub mod params;
pub mod presets;
pub mod progress;
pub mod refine;
pub mod schedule;
pub mod space;
pub mod watch;
