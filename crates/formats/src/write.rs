//! The plain case of writing: an asset and a file name.

use super::output::{self, Beside, Output, OutputOptions};
use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat_scene::{
    Asset, Result,
    report::{OutputReport, Report},
};

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
/// texture, a BVH, a separate backdrop or panorama, a collider, levels of detail and their tileset. They get their names
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
        bvh: asset.bvh.is_some(),
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
