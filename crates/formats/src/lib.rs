//! Files in and out. The types of a scene do not depend on them.
//!
//! In: bytes of scene files. Out: scenes and splats. In: assets. Out: bytes.

pub mod check;
mod faces;
mod finish;
mod format;
pub mod gltf;
mod html;
pub mod info;
mod levels;
mod lines;
mod mtl;
pub mod obj;
pub mod off;
pub mod output;
pub mod ply;
pub mod pt;
mod read;
mod source;
mod splats;
mod target;
mod tiles;
mod usdz;

pub use finish::{PLAIN_COLOR, far_origin, is_far};
pub use format::{Format, foreign_json};
pub use output::OutputOptions;
pub use read::{
    Content, WrittenFiles, holds_splats, named_files, read, read_bytes, read_content,
    read_content_bytes, read_contents, write,
};
pub use source::{ReadOptions, Source, unzipped_sog};
pub use splats::cameras::read_cameras;
pub use target::OutputTarget;
pub use tiles::{TilesetTile, TilesetWriter, bounds};
