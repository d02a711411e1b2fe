//! What a scene is about, and how it gets into a picture: its subject, where to look at it from first, what closes it far away.

mod candidates;
mod sight;

pub mod far_shell;
pub mod subject;
pub mod surroundings;
pub mod viewpoint;

pub use subject::Subject;
pub use surroundings::Surroundings;
