//! Pictures of soups, meshes, splats and baked files, for `render`, `eval`, `view` and the benchmarks.

pub(crate) mod baked_scene;
pub(crate) mod contact_sheet;
pub(crate) mod scene_renderer;
