//! The framing of a scene: its subject, its first viewpoint, and the far shell that closes it.

mod candidates;
mod orbit_range;
mod sight;

pub mod far_shell;
pub mod subject;
pub mod surroundings;
pub mod viewpoint;

pub use subject::Subject;
pub use surroundings::Surroundings;
