//! Reads a file of any format, triangles or Gaussians.

use super::read::{detect, read_as};
use super::read_options::ReadOptions;
use super::source::Source;
use super::splats;
use std::path::Path;
use trisplat_scene::{ImportedScene, ImportedSplats, Limits, Result, Splats};

/// What a file holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// Triangles.
    Scene(ImportedScene),
    /// Gaussians.
    Splats(ImportedSplats),
}

impl Content {
    /// The triangles to display, and the Gaussians that they stand for: see [`ImportedSplats::stand_in`].
    pub fn stand_in(self) -> (ImportedScene, Option<Splats>) {
        match self {
            Self::Scene(loaded) => (loaded, None),
            Self::Splats(loaded) => (loaded.stand_in(), Some(loaded.splats)),
        }
    }
}

/// The triangles or Gaussians in the file at `path`; "-" is standard input. [`read`](super::read()) refuses Gaussians. These come with
/// all their spherical harmonics, because they are drawn.
///
/// # Errors
/// Errors of the format's reader, or an unknown format.
pub fn read_content(path: &Path, options: &ReadOptions) -> Result<Content> {
    let mut source = Source::open(path, &options.limits)?;
    match splats::format_of(&mut source)? {
        Some(format) => {
            splats::read_as(format, source, &ReadOptions { sh_degree: 3, ..*options }).map(Content::Splats)
        }
        None => read_as(detect(&mut source)?, source, options).map(Content::Scene),
    }
}

/// Whether the file at `path` holds Gaussians that are read, by its first bytes. A file that cannot be read holds none, nor does standard input,
/// which is read once.
pub fn holds_splats(path: &Path, limits: &Limits) -> bool {
    if path.as_os_str() == "-" {
        return false;
    }
    let format = Source::open(path, limits).and_then(|mut source| splats::format_of(&mut source));
    format.is_ok_and(|format| format.is_some())
}
