//! Viewing scenes: camera orbits, pictures of depth, normals and layers, and drawing on a graphics card as an
//! engine does.
//!
//! In: scenes and assets. Out: pictures drawn as an engine draws them, and a window.

#[cfg(feature = "gpu")]
pub mod cull;
#[cfg(feature = "view")]
pub mod frame_rate;
#[cfg(feature = "gpu")]
pub mod headless;
#[cfg(feature = "gpu")]
pub mod layout;
#[cfg(feature = "gpu")]
pub mod model;
pub mod orbit;
#[cfg(feature = "gpu")]
mod pages;
#[cfg(feature = "gpu")]
pub mod renderer;
pub mod show;
#[cfg(feature = "view")]
pub mod window;
