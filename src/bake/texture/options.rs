//! Whether there is a texture, and how fine it is.

use crate::error::Result;
use crate::ranges::{self, Called};

/// Whether the scene gets a texture.
#[derive(Debug, Clone, PartialEq, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct TextureOptions {
    /// Give triangles texels in place of one colour each, from the photos of --dataset: more detail for few triangles. For .glb and
    /// .gltf files
    #[cfg_attr(feature = "cli", arg(long))]
    pub texture: bool,
    /// Largest width and height of the texture, texels; where it does not suffice, all triangles have fewer texels
    #[cfg_attr(feature = "cli", arg(skip = TextureOptions::DEFAULT.texture_size))]
    #[schemars(range(min = 64, max = 8192))]
    pub texture_size: u32,
    /// Texels for each pixel along an edge, in the photos that see it
    #[cfg_attr(feature = "cli", arg(skip = TextureOptions::DEFAULT.texels_per_pixel))]
    #[schemars(range(min = 0.05, max = 4.0))]
    pub texels_per_pixel: f64,
    /// λ: pull of texels towards the colour that their triangle has there, equivalent to this many pixels of 40 photos
    #[cfg_attr(feature = "cli", arg(skip = TextureOptions::DEFAULT.texture_flatness))]
    #[schemars(range(min = 0.0))]
    pub texture_flatness: f64,
}

impl TextureOptions {
    /// None.
    pub const DEFAULT: Self =
        Self { texture: false, texture_size: 4096, texels_per_pixel: 0.7, texture_flatness: 1.0 };

    pub(in crate::bake) fn validate(&self) -> Result<()> {
        ranges::check("texture", self, Called::ByFlag)
    }
}

impl Default for TextureOptions {
    fn default() -> Self {
        Self::DEFAULT
    }
}
