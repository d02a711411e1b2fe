//! Writes a scene as one GLB, or as a .gltf document and its .bin buffer.
//!
//! Lengths are known before the first byte is written, so a file streams out in blocks of about 1
//! MiB and is never held in memory as a whole. With meshopt the compressed bytes are held.

use super::compose;
use super::container::{self, Container, check_size, glb_size};
use super::encode::GltfContent;
use super::options::GltfOptions;
use std::io::Write;
use std::path::Path;
use trisplat_scene::{Asset, Error, Result};

/// Sizes and losses of a written glTF file.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct WrittenGltf {
    /// Size in bytes: the GLB, or the .gltf and its .bin together.
    pub bytes: u64,
    /// Largest distance between a vertex and its place in an engine, in file units.
    pub worst_position_error: f32,
    /// Triangles that quantisation flattened to zero area.
    pub collapsed: u64,
    /// Notes for the user, one sentence each.
    pub warnings: Vec<String>,
}

/// The bytes of `asset` as one GLB.
///
/// ```
/// use trisplat_scene::Asset;
/// use trisplat_formats::gltf::{GltfOptions, to_glb_bytes};
/// use trisplat_scene::mesh::{Colors, Mesh};
///
/// let mesh = Mesh {
///     positions: vec![[0.0, 0.0, 0.0].into(), [1.0, 0.0, 0.0].into(), [0.0, 1.0, 0.0].into()],
///     colors: Colors::Face(vec![[1.0, 0.5, 0.0]]),
///     ..Mesh::default()
/// };
/// let glb = to_glb_bytes(&Asset { mesh, ..Asset::default() }, &GltfOptions::default())?;
/// assert!(glb.starts_with(b"glTF"));
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
///
/// # Errors
/// As [`write_glb`], which streams into any writer and returns warnings too.
pub fn to_glb_bytes(asset: &Asset, options: &GltfOptions) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    write_glb(&mut bytes, Path::new("scene.glb"), asset, options)?;
    Ok(bytes)
}

/// Writes `asset` as one GLB; `path` is for messages.
///
/// Positions are written unchanged, because the bake has turned the scene Y-up.
///
/// # Errors
/// [`Error::Unsupported`] for zero triangles, [`Error::Invalid`] and [`Error::InvalidData`] for a
/// mesh or chunks that do not fit together, [`Error::TooLarge`] above 2 GiB (unless allowed) and
/// above 4 GiB, [`Error::Io`].
pub fn write_glb(
    out: &mut dyn Write,
    path: &Path,
    asset: &Asset,
    options: &GltfOptions,
) -> Result<WrittenGltf> {
    let content = GltfContent::new(path, asset, options)?;
    let json = compose::json(&content, None).map_err(|e| Error::io(path, e.into()))?;
    let bytes = glb_size(json.len() as u64, content.bin_bytes);
    let large = check_size(path, Container::Glb, bytes, options.allow_huge)?;
    let io = |e| Error::io(path, e);
    container::write_head(out, &json, content.bin_bytes).map_err(io)?;
    content.write_bin(out).map_err(io)?;
    container::write_padding(out, content.bin_bytes).map_err(io)?;
    out.flush().map_err(io)?;
    Ok(summarize(&content, bytes, large))
}

/// Writes `asset` as a .gltf document and its .bin buffer.
///
/// `bin_name` is the buffer's file name, beside the document; `path` is for messages.
///
/// # Errors
/// As [`write_glb`], but no size is refused: only a GLB has 32-bit lengths.
pub fn write_gltf(
    json: &mut dyn Write,
    bin: &mut dyn Write,
    bin_name: &str,
    path: &Path,
    asset: &Asset,
    options: &GltfOptions,
) -> Result<WrittenGltf> {
    let content = GltfContent::new(path, asset, options)?;
    let text = compose::json(&content, Some(bin_name)).map_err(|e| Error::io(path, e.into()))?;
    let bytes = text.len() as u64 + content.bin_bytes;
    let large = check_size(path, Container::Gltf, bytes, options.allow_huge)?;
    let io = |e| Error::io(path, e);
    content.write_bin(bin).map_err(|e| Error::io(path.with_file_name(bin_name), e))?;
    bin.flush().map_err(|e| Error::io(path.with_file_name(bin_name), e))?;
    json.write_all(&text).map_err(io)?;
    json.flush().map_err(io)?;
    Ok(summarize(&content, bytes, large))
}

fn summarize(content: &GltfContent, bytes: u64, large: Option<String>) -> WrittenGltf {
    let collapsed = content.parts.iter().map(|p| p.loss.collapsed).sum::<u64>();
    let mut warnings: Vec<String> = large.into_iter().collect();
    if collapsed > 0 {
        warnings.push(format!(
            "16-bit positions flattened {collapsed} of {} triangles to zero area; \
             smaller chunks or f32 positions keep them",
            content.asset.mesh.face_count()
        ));
    }
    let worst_position_error = content.parts.iter().map(|p| p.loss.worst).fold(0.0, f32::max);
    WrittenGltf { bytes, worst_position_error, collapsed, warnings }
}
