//! The glTF extensions read and written: their names, and the objects that `gltf-json` has no types for.

use serde::{Deserialize, Serialize};

/// The material shows its colour as it is, without lights.
pub(super) const UNLIT: &str = "KHR_materials_unlit";
/// Integer positions.
pub(crate) const QUANTIZATION: &str = "KHR_mesh_quantization";
/// Compressed buffer views.
pub(crate) const MESHOPT: &str = "EXT_meshopt_compression";
/// The later name of [`MESHOPT`].
pub(crate) const MESHOPT_KHR: &str = "KHR_meshopt_compression";
/// Compressed primitives, which are not read.
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";
/// Many copies of a node's mesh, which are not read.
pub(super) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Extensions that may be required: those that are read, and those that change only how a surface looks.
const READABLE: [&str; 9] = [
    QUANTIZATION,
    MESHOPT,
    MESHOPT_KHR,
    "KHR_texture_transform",
    "KHR_texture_basisu",
    "EXT_texture_webp",
    "EXT_texture_avif",
    "KHR_lights_punctual",
    // Refused where it is used, with a remedy.
    DRACO,
];

/// True when a file that requires this extension can be read.
pub(super) fn is_readable(name: &str) -> bool {
    READABLE.contains(&name) || name.starts_with("KHR_materials_")
}

/// [`MESHOPT`] on a buffer view: where its compressed bytes are, and what they become.
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

/// [`MESHOPT`] on a buffer: true for one that exists only once its views are decoded.
#[derive(Debug, Serialize)]
pub(super) struct FallbackBuffer {
    pub(super) fallback: bool,
}

/// How a view is compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum CompressionMode {
    Attributes,
    Triangles,
    Indices,
}

/// What is undone after decompression.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Filter {
    None,
    Exponential,
    Color,
}

impl CompressionMode {
    /// The name in a document.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Attributes => "ATTRIBUTES",
            Self::Triangles => "TRIANGLES",
            Self::Indices => "INDICES",
        }
    }
}

impl CompressedView {
    /// The mode, or why it is none.
    pub(super) fn mode(&self) -> Result<CompressionMode, String> {
        [CompressionMode::Attributes, CompressionMode::Triangles, CompressionMode::Indices]
            .into_iter()
            .find(|mode| mode.name() == self.mode)
            .ok_or_else(|| format!("has the unknown compression mode {:?}", self.mode))
    }

    /// The filter; none for those that are not for positions or colours.
    pub(super) fn filter(&self) -> Option<Filter> {
        match self.filter.as_deref() {
            None | Some("NONE") => Some(Filter::None),
            Some("EXPONENTIAL") => Some(Filter::Exponential),
            Some("COLOR") => Some(Filter::Color),
            Some(_) => None,
        }
    }
}
