//! Draws scenes: soft (the paper) and solid (what an engine does).
//!
//! ```text
//! soft:  project ──► sort by depth ──► tiles ──► forward ──► Frame
//!                                                backward ──► gather ──► SoupGrad
//! solid: project, clip, bin ──► tiles ──► fill ──► resolve ──► Pixels or Visibility
//! ```
//!
//! In: scenes and cameras. Out: pictures, and gradients of pictures.

pub mod framing;
pub mod kernel;

pub mod soft;
pub mod solid;
