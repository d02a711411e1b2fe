//! Scenes in memory: the stages of the bake, surfaces, and scenes in blocks.

mod bake;
mod common;
mod scale;
mod surface;
