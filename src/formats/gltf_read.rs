//! glTF 2.0 and GLB, read back.

use super::{ReadOptions, Source};
use crate::error::{Error, Result};
use crate::scene::Loaded;

/// The scene in the file.
pub fn read(source: Source, _options: &ReadOptions) -> Result<Loaded> {
    Err(Error::unsupported(&source.path, "this format is not read yet"))
}
