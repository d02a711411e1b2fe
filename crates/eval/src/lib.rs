//! Scores of scenes on photos: `trisplat eval`.
//!
//! In: scenes and held-out photos. Out: pictures and scores.

pub mod render;

pub mod coverage;
pub mod evaluate;
pub mod steps;
