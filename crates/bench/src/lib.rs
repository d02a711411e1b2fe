//! Measures cost and stability: `trisplat bench`, behind the feature `bench`.
//!
//! In: a machine. Out: figures of cost and accuracy.

pub mod bake;
#[cfg(feature = "gpu")]
pub mod card;
pub mod cost;
#[cfg(feature = "gpu")]
pub mod fps;
#[cfg(feature = "gpu")]
mod frames;
pub mod machine;
pub mod measure;
pub mod raster;
pub mod stress;
#[cfg(feature = "gpu")]
mod three;
