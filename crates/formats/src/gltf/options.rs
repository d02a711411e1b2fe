//! Options of a glTF file: storage of colours, positions and textures, names, lighting.

use gltf_json::accessor::ComponentType;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::Result;
use trisplat_scene::image::RgbImage;

/// Encoding of vertex colours: always four channels, alpha 1.
///
/// glTF 2.0 says COLOR_0 is linear light. The two sRGB encodings break that rule on purpose, for
/// Godot materials whose name ends in `-vcol`; every other viewer shows them washed out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum ColorEncoding {
    /// 16-bit normalised, linear: holds every 8-bit sRGB code exactly. 8 bytes.
    #[default]
    U16Linear,
    /// 8-bit normalised sRGB codes: against the glTF specification. 4 bytes.
    U8Srgb,
    /// 32-bit float, linear. 16 bytes.
    F32Linear,
    /// 32-bit float holding 8-bit sRGB codes over 255, rounded up for importers that truncate:
    /// against the glTF specification. 16 bytes.
    F32Srgb,
}

impl ColorEncoding {
    /// The numbers of a channel.
    pub(crate) fn component(self) -> ComponentType {
        match self {
            Self::U16Linear => ComponentType::U16,
            Self::U8Srgb => ComponentType::U8,
            Self::F32Linear | Self::F32Srgb => ComponentType::F32,
        }
    }

    /// True when the values are linear light, as the glTF specification requires.
    pub fn is_linear(self) -> bool {
        !matches!(self, Self::U8Srgb | Self::F32Srgb)
    }
}

/// Encoding of vertex positions.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum PositionEncoding {
    /// Three 32-bit floats, exact. 12 bytes.
    #[default]
    F32,
    /// Three 16-bit integers on a grid for each chunk (KHR_mesh_quantization). 8 bytes. A chunk
    /// whose grid would move a vertex by more than 1/16 of its median triangle's size, or flatten
    /// more than one triangle in 200, keeps floats.
    ChunkU16,
}

/// File format of the picture of a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "kebab-case")]
pub enum TextureFormat {
    /// JPEG of quality 90
    #[default]
    Jpeg,
    /// PNG, exact and several times as large
    Png,
}

/// Quality of a JPEG texture, of 100.
const JPEG_QUALITY: u8 = 90;

impl TextureFormat {
    /// The media type of its files.
    pub fn media_type(self) -> &'static str {
        match self {
            Self::Jpeg => "image/jpeg",
            Self::Png => "image/png",
        }
    }

    /// The ending of its files' names.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Jpeg => "jpg",
            Self::Png => "png",
        }
    }

    /// The bytes of the file of a picture.
    ///
    /// # Errors
    ///
    /// Errors of the encoder.
    pub fn bytes(self, picture: &RgbImage) -> Result<Vec<u8>> {
        match self {
            Self::Png => picture.to_png(),
            Self::Jpeg => picture.to_jpeg(JPEG_QUALITY),
        }
    }
}

/// Options of a written glTF file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GltfOptions {
    /// Storage of COLOR_0.
    pub colors: ColorEncoding,
    /// Storage of POSITION.
    pub positions: PositionEncoding,
    /// Compress with EXT_meshopt_compression (vertex codec version 0).
    pub meshopt: bool,
    /// Name of the material of faces that are drawn from both sides, and the beginning of the
    /// names of all others; Godot reads hints from its ending.
    pub material_name: String,
    /// Name of the scene's node when it is a single one.
    pub node_name: String,
    /// Name of the collision node, for engines that do not draw nodes of this name; without a name
    /// there is no such node.
    pub collision_name: Option<String>,
    /// Name of the panorama that stands beside the file in place of a backdrop, for readers that
    /// show it.
    pub sky_name: Option<String>,
    /// Write the normals of a mesh, if any, and a lit material.
    pub lit: bool,
    /// Storage of the texture, if there is one.
    pub texture: TextureFormat,
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
            node_name: "scene".to_owned(),
            collision_name: None,
            sky_name: None,
            lit: true,
            texture: TextureFormat::Jpeg,
            allow_huge: false,
        }
    }
}
