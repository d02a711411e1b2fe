//! Measures cost, stability and fidelity.

pub mod bake;
#[cfg(feature = "gpu")]
pub mod baked;
mod degenerate;
pub mod fidelity;
#[cfg(feature = "gpu")]
pub mod fps;
#[cfg(feature = "gpu")]
mod frames;
pub mod judge;
pub mod machine;
pub mod measure;
pub mod paint;
pub mod plot;
pub mod raster;
pub mod scenes;
pub mod sheet;
pub mod steps;
mod studio;
#[cfg(feature = "gpu")]
mod three;
pub mod trained;
