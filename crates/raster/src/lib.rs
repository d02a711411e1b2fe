//! Draws scenes: soft (the paper), solid (what an engine does), and Gaussian splats.
//!
//! ```text
//! soft:  project ──► sort by depth ──► tiles ──► forward ──► Frame
//!                                                backward ──► gather ──► SoupGrad
//! solid: project, clip, bin ──► tiles ──► fill ──► resolve ──► Pixels or Visibility
//! gaussian: project ──► sort by depth ──► rows of tiles ──► Frame
//! ```
//!
//! In: scenes and cameras. Out: pictures, and gradients of pictures.

pub mod framing;
pub mod gaussian;
pub mod kernel;

pub mod soft;
pub mod solid;
