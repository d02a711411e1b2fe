//! A soft scene teaches its own solid twin: pictures of it, drawn as it was trained, take the place of photos.
//!
//! They are drawn from the cameras that the scene stores and from between them. A scene without cameras is looked at
//! from where it can be seen: from around an object, from within a room.

mod chosen;
pub mod dataset;
pub mod drawing;
mod stored;
mod survey;
mod thin;
pub mod viewpoints;

pub use chosen::Search;
pub use dataset::{beside, dataset};
pub use drawing::Teacher;
pub use viewpoints::{ViewpointKind, Viewpoints};
