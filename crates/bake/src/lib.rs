//! The bake: a recipe of stages from a scene to an asset.
//!
//! ```text
//! crop → teacher → arrange → collision → prune → solid → color → unseen → exposure → reshape → backdrop → refit → texture
//! → lit → weld → place → viewpoint → chunk → bvh → order → lod → tiles
//! ```
//!
//! Each stage is a file with its options, its function and what it measures ([`StageDetails`]); it changes
//! its input or says why there was nothing to do. The recipe calls the stages and explains their order; no
//! stage depends on the recipe. [`bake()`] is the plain case, [`Bake`] takes photos and writes a report.
//!
//! Run twice, a stage has nothing to do the second time. Exceptions: `color` cannot run twice, because it
//! turns a soup into a mesh. `reshape` and `refit` come closer to the photos with every pass. `place` scales
//! again if a scale is given. `unseen` moves corners to meet a budget, and these may hide other triangles.
//!
//! [`StageDetails`]: trisplat_scene::report::StageDetails
//!
//! In: a scene, and photos where there are some. Out: an asset.

pub mod arrange;
pub mod backdrop;
pub mod bvh;
mod cells;
pub mod chunk;
pub mod collision;
pub mod color;
mod corrected_poses;
mod counts;
pub mod crop;
pub mod decimate;
pub mod exposure;
pub mod lit;
pub mod lod;
pub mod max_bytes;
pub mod merge;
pub mod mesh;
mod misfit;
mod one_origin;
pub mod options;
pub mod order;
pub mod place;
pub mod prune;
mod recipe;
pub mod refit;
pub mod reshape;
mod run;
mod shell;
pub mod solid;
pub mod teacher;
pub mod texture;
pub mod tiles;
mod trial;
pub mod unseen;
pub mod viewpoint;
pub mod views;
pub mod visibility;
pub mod weld;

pub use options::{BakeOptions, BakePreset};
pub use run::{Bake, bake};
pub use views::Views;
