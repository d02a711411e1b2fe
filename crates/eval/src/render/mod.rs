//! Pictures of soups, meshes, splats and baked files, for `render`, `eval`, `view` and the benchmarks.

pub mod baked_scene;
pub mod contact_sheet;
pub mod scene_renderer;
pub mod splats_renderer;
