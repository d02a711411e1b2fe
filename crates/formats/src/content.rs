//! Reads a file of any format, triangles or Gaussians.

use super::read::{detect, read_as};
use crate::gltf;
use crate::{Format, ReadOptions, Source, splats};
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
    match format_of_splats(&mut source, &options.limits)? {
        Some(format) => {
            read_splats(format, source, &ReadOptions { sh_degree: 3, ..*options }).map(Content::Splats)
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
    let format = Source::open(path, limits).and_then(|mut source| format_of_splats(&mut source, limits));
    format.is_ok_and(|format| format.is_some())
}

/// The format of an open file when it holds Gaussians that are read.
pub(super) fn format_of_splats(source: &mut Source, limits: &Limits) -> Result<Option<Format>> {
    if let Some(format) = splats::format_of(source)? {
        return Ok(Some(format));
    }
    let format = Format::detect(&source.head()?, &source.named());
    match format {
        Some(Format::Glb | Format::Gltf) if gltf::holds_splats(source, limits)? => Ok(format),
        _ => Ok(None),
    }
}

/// The Gaussians in an open file of that format, with the cameras in a list beside it.
pub(super) fn read_splats(format: Format, source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    match format {
        Format::Glb | Format::Gltf => gltf::read_splats(source, options),
        _ => splats::read_as(format, source, options),
    }
}
