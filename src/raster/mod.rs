//! Draws scenes: soft (the paper) and solid (what an engine does).
//!
//! ```text
//! soft:  project ──► sort by depth ──► tiles ──► forward ──► Frame
//!                                                backward ──► gather ──► SoupGrad
//! solid: project, cut, bin ──► tiles ──► fill ──► resolve ──► Pixels or Visibility
//! ```

mod backward;
mod contributions;
mod corners;
mod forward;
mod gather;
mod hits;
pub mod importance;
mod project;
mod shade;
pub mod soft;
pub mod solid;
mod sort;
mod tiles;
