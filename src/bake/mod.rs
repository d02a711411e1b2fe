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
