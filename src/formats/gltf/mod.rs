//! glTF 2.0 and GLB, written: unlit, double-sided, opaque triangles with a colour a vertex.
//!
//! ```text
//! Asset ──► chunk (one mesh + node each: bounds, grid, streams) ──► document (the JSON)
//!                                     │                                   │
//!                                     └──► encode ──► (meshopt) ──► container ──► bytes
//! ```
//!
//! Lengths are known before the first byte is written, so a file streams out in blocks of about
//! 1 MiB and is never held in memory as a whole. With meshopt the compressed bytes are held.

mod chunk;
mod container;
pub(super) mod document;
mod encode;
mod grid;
mod meshopt;

use crate::asset::Asset;
use crate::error::{Error, Result};
use chunk::{Part, Stream};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::path::Path;

pub use container::{Container, check_size, glb_bytes, place};

/// How a vertex stores its colour: always four channels, alpha 1.
///
/// glTF 2.0 says COLOR_0 is linear light. The two sRGB encodings break that rule on purpose, for
/// Godot materials whose name ends in `-vcol`; every other viewer shows them washed out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum ColorEncoding {
    /// 16-bit normalised, linear: holds every 8-bit sRGB code exactly. 8 bytes.
    #[default]
    #[serde(rename = "u16-linear")]
    #[cfg_attr(feature = "cli", value(name = "u16-linear"))]
    U16Linear,
    /// 8-bit normalised, linear: 73 of the 256 sRGB codes come back wrong, by up to 6. 4 bytes.
    #[serde(rename = "u8-linear")]
    #[cfg_attr(feature = "cli", value(name = "u8-linear"))]
    U8Linear,
    /// 8-bit normalised sRGB codes: not what the glTF specification says. 4 bytes.
    #[serde(rename = "u8-srgb")]
    #[cfg_attr(feature = "cli", value(name = "u8-srgb"))]
    U8Srgb,
    /// 32-bit float, linear. 16 bytes.
    #[serde(rename = "f32-linear")]
    #[cfg_attr(feature = "cli", value(name = "f32-linear"))]
    F32Linear,
    /// 32-bit float holding 8-bit sRGB codes over 255, rounded up so that an importer which
    /// truncates gets the code: not what the glTF specification says. 16 bytes.
    #[serde(rename = "f32-srgb")]
    #[cfg_attr(feature = "cli", value(name = "f32-srgb"))]
    F32Srgb,
}

impl ColorEncoding {
    /// Bytes a vertex.
    pub fn bytes(self) -> u64 {
        match self {
            Self::U16Linear => 8,
            Self::U8Linear | Self::U8Srgb => 4,
            Self::F32Linear | Self::F32Srgb => 16,
        }
    }

    /// True when the values are linear light, as the glTF specification wants.
    pub fn is_linear(self) -> bool {
        !matches!(self, Self::U8Srgb | Self::F32Srgb)
    }
}

/// How a vertex stores its position.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
pub enum PositionEncoding {
    /// Three 32-bit floats, exact. 12 bytes.
    #[default]
    #[serde(rename = "f32")]
    #[cfg_attr(feature = "cli", value(name = "f32"))]
    F32,
    /// Three 16-bit integers on a grid of the chunk's own (KHR_mesh_quantization). 8 bytes.
    #[serde(rename = "chunk-u16")]
    #[cfg_attr(feature = "cli", value(name = "chunk-u16"))]
    ChunkU16,
}

impl PositionEncoding {
    /// Bytes a vertex, padding included.
    pub fn bytes(self) -> u64 {
        match self {
            Self::F32 => 12,
            Self::ChunkU16 => 8,
        }
    }
}

/// What to write and how.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GltfOptions {
    /// Storage of COLOR_0.
    pub colors: ColorEncoding,
    /// Storage of POSITION.
    pub positions: PositionEncoding,
    /// Compress with EXT_meshopt_compression (vertex codec version 0).
    pub meshopt: bool,
    /// Name of the only material; Godot reads hints from its end.
    pub material_name: String,
    /// Write a GLB above 2 GiB although most readers fail on it.
    pub allow_huge: bool,
}

impl Default for GltfOptions {
    fn default() -> Self {
        Self {
            colors: ColorEncoding::default(),
            positions: PositionEncoding::default(),
            meshopt: false,
            material_name: "trisplat".to_owned(),
            allow_huge: false,
        }
    }
}

/// What was written.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Written {
    /// Size in bytes: the GLB, or the .gltf and its .bin together.
    pub bytes: u64,
    /// Largest distance between a vertex and where an engine puts it, in file units.
    pub worst_position_error: f32,
    /// Triangles that quantisation flattened to zero area.
    pub collapsed: u64,
    /// What the user should know, one sentence each.
    pub warnings: Vec<String>,
}

/// Writes `asset` as one GLB and returns what was written; `path` is for messages.
///
/// The mesh is written where it stands: the bake has placed it (Y up) already.
///
/// # Errors
/// [`Error::Unsupported`] for zero triangles, [`Error::Invalid`] for a mesh or chunks that do not fit
/// together, [`Error::TooLarge`] above 2 GiB (unless allowed) and above 4 GiB, [`Error::Io`].
pub fn write_glb(out: &mut dyn Write, path: &Path, asset: &Asset, options: &GltfOptions) -> Result<Written> {
    let content = Content::new(path, asset, options)?;
    let json = content.json(path, None, false)?;
    let bytes = glb_bytes(json.len() as u64, content.bin_bytes);
    let large = check_size(path, Container::Glb, bytes, options.allow_huge)?;
    let io = |e| Error::io(path, e);
    container::write_head(out, &json, content.bin_bytes).map_err(io)?;
    content.write_bin(out).map_err(io)?;
    container::write_padding(out, content.bin_bytes).map_err(io)?;
    out.flush().map_err(io)?;
    Ok(content.written(bytes, large))
}

/// Writes `asset` as a .gltf document and its .bin buffer and returns what was written.
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
) -> Result<Written> {
    let content = Content::new(path, asset, options)?;
    let text = content.json(path, Some(bin_name), true)?;
    let bytes = text.len() as u64 + content.bin_bytes;
    let large = check_size(path, Container::Gltf, bytes, options.allow_huge)?;
    let io = |e| Error::io(path, e);
    content.write_bin(bin).map_err(|e| Error::io(path.with_file_name(bin_name), e))?;
    bin.flush().map_err(|e| Error::io(path.with_file_name(bin_name), e))?;
    json.write_all(&text).map_err(io)?;
    json.flush().map_err(io)?;
    Ok(content.written(bytes, large))
}

/// Everything but the bytes themselves: what goes where in the binary buffer.
struct Content<'a> {
    asset: &'a Asset,
    options: &'a GltfOptions,
    parts: Vec<Part<'a>>,
    /// Compressed streams in file order, when compressing.
    compressed: Option<Vec<Vec<u8>>>,
    /// Where each stream starts in the file's buffer, in file order.
    starts: Vec<u64>,
    bin_bytes: u64,
}

impl<'a> Content<'a> {
    fn new(path: &Path, asset: &'a Asset, options: &'a GltfOptions) -> Result<Self> {
        let parts = chunk::parts(path, asset, options)?;
        let compressed = if options.meshopt {
            Some(meshopt::compress(&asset.mesh, &parts, options).map_err(|e| Error::unsupported(path, e))?)
        } else {
            None
        };
        let (starts, bin_bytes) = match &compressed {
            Some(streams) => place(streams.iter().map(|s| s.len() as u64)),
            None => place(all_streams(&parts).map(|(part, stream)| part.bytes(stream, options))),
        };
        Ok(Self { asset, options, parts, compressed, starts, bin_bytes })
    }

    fn json(&self, path: &Path, bin_name: Option<&str>, pretty: bool) -> Result<Vec<u8>> {
        let document = document::Document::new(self, bin_name);
        let text = if pretty { serde_json::to_vec_pretty(&document) } else { serde_json::to_vec(&document) };
        text.map_err(|e| Error::io(path, e.into()))
    }

    /// Streams the binary buffer, padding between the streams included.
    fn write_bin(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let mut at = 0;
        let mut scratch = Vec::new();
        for (i, (part, stream)) in all_streams(&self.parts).enumerate() {
            container::write_padding(out, at)?;
            at = self.starts[i];
            at += match &self.compressed {
                Some(streams) => {
                    out.write_all(&streams[i])?;
                    streams[i].len() as u64
                }
                None => {
                    encode::write(out, &self.asset.mesh, part, stream, self.options, &mut scratch)?;
                    part.bytes(stream, self.options)
                }
            };
        }
        Ok(())
    }

    fn written(&self, bytes: u64, large: Option<String>) -> Written {
        let collapsed = self.parts.iter().map(|p| p.loss.collapsed).sum::<u64>();
        let mut warnings: Vec<String> = large.into_iter().collect();
        if collapsed > 0 {
            warnings.push(format!(
                "16-bit positions flattened {collapsed} of {} triangles to zero area; \
                 smaller chunks or f32 positions keep them",
                self.asset.mesh.face_count()
            ));
        }
        let worst_position_error = self.parts.iter().map(|p| p.loss.worst).fold(0.0, f32::max);
        Written { bytes, worst_position_error, collapsed, warnings }
    }
}

/// Every stream of every part, in file order.
fn all_streams<'a, 'b>(parts: &'b [Part<'a>]) -> impl Iterator<Item = (&'b Part<'a>, Stream)> {
    parts.iter().flat_map(|part| part.streams().map(move |stream| (part, stream)))
}
