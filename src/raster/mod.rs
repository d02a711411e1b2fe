//! Draws scenes: soft (the paper) and solid (what an engine does).
//!
//! ```text
//! soft:  project ──► sort by depth ──► tiles ──► forward ──► Frame
//!                                                backward ──► gather ──► SoupGrad
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
mod sort;
mod tiles;
