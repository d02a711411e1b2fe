//! Scenes, cameras, pictures and numbers of trisplat.
//!
//! In: nothing. Out: soups, meshes, scenes, splats, cameras, pictures, BVH, assets; numbers, errors, reports; files that are read within limits and appear whole.

pub mod asset;
pub mod atomic;
pub mod budget;
pub mod bvh;
pub mod camera;
pub mod error;
pub mod guard;
pub mod image;
pub mod input;
pub mod layered;
pub mod limits;
pub mod math;
pub mod mesh;
pub mod placed;
pub mod process;
pub mod ranges;
pub mod region;
pub mod report;
pub mod rng;
pub mod scene;
pub mod soup;
pub mod space;
pub mod splats;
pub mod texture;
pub mod work;
