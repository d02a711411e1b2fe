//! Measures cost, stability and fidelity.

pub mod bake;
mod degenerate;
pub mod fidelity;
pub mod machine;
pub mod measure;
pub mod paint;
pub mod plot;
pub mod raster;
pub mod scenes;
pub mod sheet;
pub mod steps;
mod studio;
