//! PLY: our soup PLY, and vertex-coloured triangle meshes.

use super::{ReadOptions, Source};
use crate::error::{Error, Result};
use crate::scene::Loaded;

/// The scene in the file.
pub fn read(source: Source, _options: &ReadOptions) -> Result<Loaded> {
    Err(Error::unsupported(&source.path, "this format is not read yet"))
}
