//! Reads a file of any format, triangles or Gaussians; the plain case of writing.

use crate::output::{Beside, Output, OutputOptions};
use crate::read::{detect, read_as};
use crate::{Format, ReadOptions, Source, gltf, output, splats};
use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat_scene::report::{OutputReport, Report};
use trisplat_scene::{Asset, ImportedScene, ImportedSplats, Limits, Result, Splats};

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

/// The triangles or Gaussians in the file at `path`; "-" is standard input. [`read`](crate::read()) refuses Gaussians. These come with
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

// ---- The plain case of writing: an asset and a file name ---------------------------------------------

/// What [`write()`] wrote.
#[derive(Debug, Clone, PartialEq)]
pub struct WrittenFiles {
    /// Every file and its size: the requested one first, then those beside it.
    pub files: Vec<OutputReport>,
    /// Notes for the user, one sentence each.
    pub warnings: Vec<String>,
}

/// Writes an asset in the format of the ending of `path`: .glb, .gltf, .obj, .ply, .usdz, .html or .tileset.json.
///
/// Files that belong to it go beside it: the .bin of a glTF, the .mtl of an OBJ and the picture of its
/// texture, a separate backdrop or panorama, a collider, levels of detail and their tileset. They get their names
/// when all of them are complete. Existing files are replaced.
///
/// ```
/// use trisplat_scene::Asset;
/// use trisplat_formats::{self as formats, OutputOptions, ReadOptions};
/// use trisplat_scene::mesh::{Colors, Mesh};
///
/// let mesh = Mesh {
///     positions: vec![glam::Vec3::ZERO, glam::Vec3::X, glam::Vec3::Y],
///     colors: Colors::Face(vec![[1.0, 0.5, 0.0]]), // linear RGB
///     ..Mesh::default()
/// };
/// # let folder = tempfile::tempdir().unwrap();
/// # let path = folder.path().join("triangle.glb");
/// let written = formats::write(&Asset::from(mesh), &path, &OutputOptions::default())?;
/// assert_eq!(written.files.len(), 1);
/// let back = formats::read(&path, &ReadOptions::default())?;
/// assert_eq!(back.scene.triangle_count(), 1);
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
///
/// # Errors
/// `Invalid` for a name without a known ending, or standard output for several files; `TooLarge` for a scene
/// that exceeds the format; `Io`.
pub fn write(asset: &Asset, path: &Path, options: &OutputOptions) -> Result<WrittenFiles> {
    let beside = Beside {
        levels: asset.levels.len(),
        backdrop: asset.backdrop_apart,
        sky: asset.sky.is_some(),
        collision: asset.collision.is_some(),
        texture: asset.mesh.texture.is_some(),
    };
    let output = Output::of_scene(path, None, options, &beside)?;
    let mut report = Report::new("write");
    output::write(asset, &output, output.start()?, options, &mut report, &mut |_| Continue(()))?;
    Ok(WrittenFiles { files: report.outputs, warnings: report.warnings })
}
