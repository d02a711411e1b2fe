//! Scene files that trainers and tools exchange, and what every reader of a file shares.
//!
//! In: bytes of PLY, checkpoints, OFF, OBJ and Gaussian splats. Out: scenes and splats; PLY, OBJ and USDZ of assets.

mod blocks;
mod channel;
mod digits;
mod faces;
pub mod far;
pub mod findings;
mod finish;
pub mod foreign;
mod format;
pub mod gaussians;
mod lines;
pub mod obj;
pub mod off;
pub mod painted;
pub mod ply;
mod provenance;
pub mod pt;
mod read_options;
mod source;
pub mod splats;
pub mod usdz;

pub use faces::MAX_CORNERS;
pub use finish::finish;
pub use format::Format;
pub use read_options::ReadOptions;
pub use source::{Source, is_packed};
