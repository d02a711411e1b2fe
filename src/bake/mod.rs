//! The bake: a short recipe of stages from a scene to an asset.

pub mod bvh;
pub mod chunk;
pub mod color;
pub mod options;
pub mod order;
pub mod prune;
pub mod solid;
pub mod target;
pub mod weld;

/// Figures of a stage for the report: counts by cause, errors, sizes.
pub type Details = serde_json::Map<String, serde_json::Value>;
