//! Scores of scenes on photos: `trisplat eval`.

pub mod coverage;
pub mod evaluate;
pub mod steps;
