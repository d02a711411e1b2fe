//! Files in and out. The types of a scene do not depend on them.
//!
//! In: bytes of scene files. Out: scenes and splats. In: assets. Out: bytes.

pub mod bvh;
pub mod check;
mod content;
mod html;
pub mod info;
mod levels;
mod named;
pub mod output;
mod read;
mod target;
mod tiles;
mod tileset;
mod tileset_info;
mod tileset_json;
mod write;

pub use content::{Content, holds_splats, read_content};
pub use named::named_files;
pub use output::OutputOptions;
pub use read::read;
pub use target::{OutputTarget, TargetEncoding};
pub use tiles::TilesetWriter;
pub use tileset::{TilesetTile, bounds};
pub use tileset_info::{TilesetInfo, tileset_info};
pub use write::{WrittenFiles, write};

pub use trisplat_exchange::far::{far_origin, is_far};
pub use trisplat_exchange::{
    Format, MAX_CORNERS, ReadOptions, Source, finish, foreign, obj, off, ply, pt, splats,
};
pub use trisplat_gltf as gltf;
