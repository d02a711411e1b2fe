//! Files in and out. The types of a scene do not depend on them.
//!
//! In: bytes of scene files. Out: scenes and splats. In: assets. Out: bytes.

pub mod check;
mod content;
mod faces;
mod far;
mod findings;
mod finish;
mod foreign;
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
pub mod ply;
mod provenance;
pub mod pt;
mod read;
mod read_options;
mod source;
pub mod splats;
mod target;
mod tiles;
mod usdz;

pub use content::{Content, WrittenFiles, holds_splats, read_content, write};
pub use faces::MAX_CORNERS;
pub use far::{far_origin, is_far};
pub use finish::finish;
pub use foreign::foreign_json;
pub use format::Format;
pub use named::named_files;
pub use output::OutputOptions;
pub use read::{read, read_bytes};
pub use read_options::ReadOptions;
pub use source::Source;
pub use target::{OutputTarget, TargetEncoding};
pub use tiles::{TilesetTile, TilesetWriter, bounds};
