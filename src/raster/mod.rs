//! Draws scenes: soft (the paper) and solid (what an engine does).
//!
//! ```text
//! soft:  project ──► sort by depth ──► tiles ──► forward ──► Frame
//!                                                backward ──► gather ──► SoupGrad
//! solid: project, clip, bin ──► tiles ──► fill ──► resolve ──► Pixels or Visibility
//! ```

pub mod soft;
pub mod solid;
