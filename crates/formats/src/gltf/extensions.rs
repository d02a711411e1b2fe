//! The glTF extensions read and written: their names, and the objects without types in `gltf-json`.

use crate::gaussians;
use serde::{Deserialize, Serialize};

/// The material shows its colour without lights.
pub(crate) const UNLIT: &str = "KHR_materials_unlit";
/// Integer positions.
pub(crate) const QUANTIZATION: &str = "KHR_mesh_quantization";
/// Compressed buffer views.
pub(crate) const MESHOPT: &str = "EXT_meshopt_compression";
/// The later name of [`MESHOPT`].
pub(crate) const MESHOPT_KHR: &str = "KHR_meshopt_compression";
/// Compressed primitives, which are not read.
pub(crate) const DRACO: &str = "KHR_draco_mesh_compression";
/// Many copies of a node's mesh, which are not read.
pub(crate) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Extensions that a file may require: those that are read, and those that only change the look of a surface.
const READABLE: [&str; 10] = [
    gaussians::GLTF_EXTENSION,
    QUANTIZATION,
    MESHOPT,
    MESHOPT_KHR,
    "KHR_texture_transform",
    // Its pictures are named in a warning.
    "KHR_texture_basisu",
    "EXT_texture_webp",
    "EXT_texture_avif",
    "KHR_lights_punctual",
    // Refused at its use, with a remedy.
    DRACO,
];

/// True when a file that requires this extension can be read.
pub(crate) fn is_readable(name: &str) -> bool {
    READABLE.contains(&name) || name.starts_with("KHR_materials_")
}

/// [`MESHOPT`] on a buffer view: the place of its compressed bytes, and their decoded form.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct CompressedView {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) byte_length: u64,
    pub(crate) byte_stride: u64,
    pub(crate) count: u64,
    /// One of [`CompressionMode`]'s names.
    pub(crate) mode: String,
    /// One of [`Filter`]'s names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) filter: Option<String>,
}

/// [`MESHOPT`] on a buffer: true for a buffer that exists only after decoding.
#[derive(Debug, Serialize)]
pub(crate) struct FallbackBuffer {
    pub(crate) fallback: bool,
}

/// How a view is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum CompressionMode {
    Attributes,
    Triangles,
    Indices,
}

/// What is undone after decompression.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Filter {
    None,
    Exponential,
    Color,
}

impl CompressionMode {
    /// The name in a document.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Attributes => "ATTRIBUTES",
            Self::Triangles => "TRIANGLES",
            Self::Indices => "INDICES",
        }
    }
}

impl CompressedView {
    /// The mode, or the reason why it is invalid.
    pub(crate) fn mode(&self) -> Result<CompressionMode, String> {
        [CompressionMode::Attributes, CompressionMode::Triangles, CompressionMode::Indices]
            .into_iter()
            .find(|mode| mode.name() == self.mode)
            .ok_or_else(|| format!("has the unknown compression mode {:?}", self.mode))
    }

    /// The filter; none for filters of other data than positions or colours.
    pub(crate) fn filter(&self) -> Option<Filter> {
        match self.filter.as_deref() {
            None | Some("NONE") => Some(Filter::None),
            Some("EXPONENTIAL") => Some(Filter::Exponential),
            Some("COLOR") => Some(Filter::Color),
            Some(_) => None,
        }
    }
}
