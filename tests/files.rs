//! Files in and out: photos, soups, meshes, glTF, checkpoints; whole ones, odd ones and mutants.

mod common;
mod dataset;
mod formats;
mod gltf;
mod gltf_read;
mod pt;
#[path = "common/skip.rs"]
mod skip;
