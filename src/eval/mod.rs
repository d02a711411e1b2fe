//! How close a scene comes to photos: `trisplat eval`.

pub mod coverage;
pub mod evaluate;
pub mod steps;
