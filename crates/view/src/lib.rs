//! Viewing scenes: pictures of depth, normals and wires, and drawing on a graphics card as an
//! engine does.
//!
//! In: scenes and assets. Out: pictures drawn as an engine draws them, and a window.

#[cfg(feature = "gpu")]
mod model;
#[cfg(feature = "gpu")]
mod renderer;
pub mod show;
#[cfg(feature = "view")]
pub mod window;

#[cfg(feature = "gpu")]
pub use model::Model;
#[cfg(feature = "gpu")]
pub use renderer::{Canvas, DrawStats, FrameParams, Headless};
