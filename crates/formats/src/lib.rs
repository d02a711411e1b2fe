//! Files in and out. The types of a scene do not depend on them.
//!
//! In: bytes of scene files. Out: scenes and splats. In: assets. Out: bytes.

mod blocks;
pub mod bvh;
mod channel;
pub mod check;
mod check_triangles;
mod content;
mod digits;
mod faces;
mod far;
mod findings;
mod finish;
pub mod foreign;
mod format;
mod gaussians;
pub mod gltf;
mod html;
pub mod info;
mod levels;
mod lines;
mod named;
pub mod obj;
pub mod off;
pub mod output;
mod painted;
pub mod ply;
mod provenance;
pub mod pt;
mod read;
mod read_options;
mod source;
pub mod splats;
mod target;
mod tiles;
mod tileset;
mod usdz;
mod write;

pub use content::{Content, holds_splats, read_content};
pub use faces::MAX_CORNERS;
pub use far::{far_origin, is_far};
pub use finish::finish;
pub use format::Format;
pub use named::named_files;
pub use output::OutputOptions;
pub use read::read;
pub use read_options::ReadOptions;
pub use source::Source;
pub use target::{OutputTarget, TargetEncoding};
pub use tiles::TilesetWriter;
pub use tileset::{TilesetTile, bounds};
pub use write::{WrittenFiles, write};
