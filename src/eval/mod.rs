//! Scores of scenes on photos: `trisplat eval`.

pub mod coverage;
pub mod evaluate;
mod refined_pose;
pub mod steps;
