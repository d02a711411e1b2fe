//! Pictures of soups, meshes and baked files, for `render`, `eval`, `view` and the benchmarks.

pub mod baked_scene;
pub mod contact_sheet;
pub mod scene_renderer;
