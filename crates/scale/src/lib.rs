//! Scenes of more photos and triangles than one run holds: cut into blocks, each trained on its
//! own, on any machine, and merged again.
//!
//! ```text
//! plan: coarse scene ──► cuts ──► assign ──► manifest.json, coarse.ply, start-*.ply
//!                                                │
//!                      task (one block, anywhere) ──► block-*.ply ──► merge ──► scene.ply
//!                                                                └──► tileset, block by block
//! ```
//!
//! As in Liu et al. 2024 (*CityGaussian*), a coarse scene of all photos comes first. Blocks start
//! from their parts of it, and each gets the photos that show it, judged by that scene. Opaque
//! triangles need no blending where blocks meet: a triangle belongs to the block that holds its
//! centroid.
//!
//! In: a data set that is too large for one run. Out: blocks, and one scene made of them.

mod cover;
mod manifest;
mod merge;
mod plan;
mod region;
mod task;

pub use manifest::{Expected, Manifest, NAME, PlanOptions, find_coarse, is_plan};
pub use merge::{Blocks, bake_tiles};
pub use plan::{Planner, check, keep_coarse};
pub use task::{Task, status, unnamed};
