//! Options of the texture.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::Path;
use trisplat_formats::output::OutputFormat;
use trisplat_scene::ranges::{self, OptionNaming};
use trisplat_scene::{Error, Result};

/// Source of the texels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum TextureDetail {
    /// Best for a connected surface, mean for a soup
    Auto,
    /// The mean of all photos that see a place
    Mean,
    /// The mean, and the detail of the photo that shows a triangle best
    Best,
}

/// Condition for a texture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum TextureWhen {
    /// Never: triangles show colours
    #[default]
    Off,
    /// Always
    On,
    /// Unless held-out photos match the colours better, by PSNR and by SSIM
    Auto,
}

/// Options of the texture.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[cfg_attr(feature = "cli", derive(clap::Args))]
#[serde(deny_unknown_fields, default)]
pub struct TextureOptions {
    /// Give triangles texels in place of one colour each, from the photos: more detail for few
    /// triangles. For .glb, .gltf, .html, .obj, .usdz (without being asked, as phones show no
    /// colours there) and .tileset.json files
    #[cfg_attr(feature = "cli", arg(long, value_enum, default_value_t = TextureOptions::DEFAULT.texture, num_args = 0..=1,
          require_equals = true, default_missing_value = "on", value_name = "WHEN"))]
    pub texture: TextureWhen,
    /// Largest width and height of the texture, texels; where they do not suffice, all triangles
    /// have fewer
    #[cfg_attr(feature = "cli", arg(skip = TextureOptions::DEFAULT.texture_size))]
    #[schemars(range(min = 64, max = 8192))]
    pub texture_size: u32,
    /// Texels for each pixel along an edge, in the photos that see it
    #[cfg_attr(feature = "cli", arg(skip = TextureOptions::DEFAULT.texels_per_pixel))]
    #[schemars(range(min = 0.05, max = 4.0))]
    pub texels_per_pixel: f64,
    /// λ: pull of texels towards the colour that their triangle has there, equivalent to this many
    /// pixels of 40 photos
    #[cfg_attr(feature = "cli", arg(skip = TextureOptions::DEFAULT.texture_flatness))]
    #[schemars(range(min = 0.0, max = 1e9))]
    pub texture_flatness: f64,
    /// Whose detail texels show
    #[cfg_attr(feature = "cli", arg(skip = TextureOptions::DEFAULT.texture_detail))]
    pub texture_detail: TextureDetail,
}

impl TextureOptions {
    /// None.
    pub const DEFAULT: Self = Self {
        texture: TextureWhen::Off,
        texture_size: 4096,
        texels_per_pixel: 0.7,
        texture_flatness: 1.0,
        texture_detail: TextureDetail::Auto,
    };

    /// True if there may be a texture.
    pub fn is_wanted(&self) -> bool {
        self.texture != TextureWhen::Off
    }

    /// Refuses a format that holds no texture, if there is one.
    ///
    /// # Errors
    ///
    /// A format without textures.
    pub fn check_format(&self, path: &Path, format: OutputFormat) -> Result<()> {
        if self.is_wanted() && format == OutputFormat::Ply {
            let wants = "a name ending in .glb, .gltf, .html, .obj, .usdz or .tileset.json, whose files hold a texture, or no `texture`";
            return Err(Error::invalid("output", path.display(), wants));
        }
        Ok(())
    }

    pub(crate) fn validate(&self) -> Result<()> {
        ranges::check(self, OptionNaming::Flag)
    }
}

trisplat_scene::default!(TextureOptions);
