//! Measures cost, stability and fidelity.

#[cfg(feature = "cli")]
pub mod bake;
pub mod baked_scene;
#[cfg(all(feature = "cli", feature = "gpu"))]
pub mod card;
pub mod contact_sheet;
#[cfg(feature = "cli")]
pub mod cost;
pub mod coverage;
mod degenerate;
pub mod evaluate;
#[cfg(feature = "cli")]
pub mod fidelity;
#[cfg(all(feature = "cli", feature = "gpu"))]
pub mod fps;
#[cfg(all(feature = "cli", feature = "gpu"))]
mod frames;
pub mod machine;
pub mod measure;
#[cfg(feature = "cli")]
pub mod plot;
#[cfg(feature = "cli")]
pub mod raster;
pub mod scene_renderer;
pub mod scenes;
pub mod steps;
pub mod stress;
mod studio;
#[cfg(all(feature = "cli", feature = "gpu"))]
mod three;
pub mod town;
pub mod town_photos;
pub mod training;
