//! Materials and textures of a document: the colour of a surface, and the place of a picture on it.
//!
//! Of a material only its colour without lights and its sides are read. Faults in it cost no more
//! than these.

use super::sh::ShExtras;
use gltf_json::material::{AlphaCutoff, AlphaMode};
use gltf_json::validation::Checked;
use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, IgnoredAny};
use serde_json::Value;
use std::collections::BTreeMap;
use trisplat_scene::TexelFilter;
use trisplat_scene::atlas::Wrap;

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct GltfMaterial {
    name: Option<String>,
    alpha_mode: Option<Checked<AlphaMode>>,
    alpha_cutoff: Option<f32>,
    #[serde(default, deserialize_with = "lenient")]
    double_sided: Option<bool>,
    #[serde(default)]
    pbr_metallic_roughness: BaseColor,
    #[serde(default, deserialize_with = "lenient")]
    emissive_factor: Option<[f32; 3]>,
    #[serde(default, deserialize_with = "lenient")]
    emissive_texture: Option<GltfTextureInfo>,
    #[serde(default, deserialize_with = "lenient")]
    occlusion_texture: Option<GltfTextureInfo>,
    #[serde(default, deserialize_with = "lenient")]
    extras: Option<MaterialExtras>,
    #[serde(default)]
    extensions: MaterialExtensions,
}

/// Extras of a material in files of this program.
#[derive(Debug, Deserialize)]
struct MaterialExtras {
    trisplat_sh: Option<ShExtras>,
}

/// Endings of material names for which Godot, and only Godot, reads vertex colours as sRGB.
const SRGB_HINTS: [&str; 3] = ["-vcol", "$vcol", "_vcol"];

/// Extensions that only say how light passes, and do nothing where none does.
const INSIDE_GLASS: [&str; 4] = [
    "KHR_materials_ior",
    "KHR_materials_volume",
    "KHR_materials_dispersion",
    "KHR_materials_volume_scatter",
];

/// The colour of a surface without lights.
pub(crate) struct Paint<'a> {
    /// Linear RGB and alpha, which multiply the texture.
    pub(crate) factor: [f32; 4],
    pub(crate) texture: Option<&'a GltfTextureInfo>,
    /// True when the surface also emits light, which is not read.
    pub(crate) emits_more: bool,
}

impl GltfMaterial {
    /// The colour of its surface, or its emitted light where that is black.
    pub(crate) fn paint(&self) -> Paint<'_> {
        let base = match &self.extensions.specular_glossiness {
            Some(gloss) => gloss,
            None => &self.pbr_metallic_roughness,
        };
        let [r, g, b, alpha] = base.factor.unwrap_or([1.0; 4]);
        let strength =
            self.extensions.emissive_strength.as_ref().map_or(1.0, |light| light.strength);
        let light = self.emissive_factor.unwrap_or_default().map(|x| (x * strength).min(1.0));
        let shines = light.iter().any(|x| *x > 0.0) && !self.extensions.unlit;
        if shines && [r, g, b] == [0.0; 3] {
            Paint {
                factor: [light[0], light[1], light[2], alpha],
                texture: self.emissive_texture.as_ref(),
                emits_more: false,
            }
        } else {
            Paint { factor: [r, g, b, alpha], texture: base.texture.as_ref(), emits_more: shines }
        }
    }

    /// The extension by which light passes its surface, as glass does.
    pub(crate) fn transmission(&self) -> Option<&'static str> {
        let passes = |by: &Option<Transmission>| by.as_ref().is_some_and(|by| by.factor > 0.0);
        if passes(&self.extensions.transmission) {
            Some("KHR_materials_transmission")
        } else if passes(&self.extensions.diffuse_transmission) {
            Some("KHR_materials_diffuse_transmission")
        } else {
            None
        }
    }

    /// Its extensions that are not read and change how the surface looks in light.
    pub(crate) fn unread(&self) -> impl Iterator<Item = &str> {
        let names = self.extensions.others.keys().map(String::as_str);
        names.filter(|name| !INSIDE_GLASS.contains(name))
    }

    /// True when its colours are shown as they are, without light.
    pub(crate) fn is_unlit(&self) -> bool {
        self.extensions.unlit
    }

    /// True when alpha is ignored.
    pub(crate) fn is_opaque(&self) -> bool {
        !matches!(self.alpha_mode, Some(Checked::Valid(AlphaMode::Mask | AlphaMode::Blend)))
    }

    /// Its spherical harmonics, and the texture that they are in.
    pub(crate) fn sh(&self) -> Option<(&ShExtras, &GltfTextureInfo)> {
        let extras = self.extras.as_ref()?.trisplat_sh.as_ref();
        extras.filter(|sh| sh.is_possible()).zip(self.occlusion_texture.as_ref())
    }

    /// True when triangles are drawn from both sides.
    pub(crate) fn is_double_sided(&self) -> bool {
        self.double_sided.unwrap_or(false)
    }

    /// True when Godot, and only Godot, reads its vertex colours as sRGB, because of the ending of
    /// its name.
    pub(crate) fn is_srgb(&self) -> bool {
        let name = self.name.as_deref().unwrap_or_default().to_ascii_lowercase();
        SRGB_HINTS.iter().any(|hint| name.ends_with(hint))
    }

    /// Minimum alpha of a drawn place, if the alpha only cuts out.
    pub(crate) fn cutoff(&self) -> Option<f32> {
        let is_mask = self.alpha_mode == Some(Checked::Valid(AlphaMode::Mask));
        is_mask.then(|| self.alpha_cutoff.unwrap_or(AlphaCutoff::default().0))
    }
}

#[derive(Debug, Default, Deserialize)]
struct BaseColor {
    #[serde(rename = "baseColorFactor", alias = "diffuseFactor")]
    factor: Option<[f32; 4]>,
    #[serde(
        default,
        rename = "baseColorTexture",
        alias = "diffuseTexture",
        deserialize_with = "lenient"
    )]
    texture: Option<GltfTextureInfo>,
}

#[derive(Debug, Default, Deserialize)]
struct MaterialExtensions {
    #[serde(default, rename = "KHR_materials_transmission", deserialize_with = "lenient")]
    transmission: Option<Transmission>,
    #[serde(default, rename = "KHR_materials_diffuse_transmission", deserialize_with = "lenient")]
    diffuse_transmission: Option<Transmission>,
    #[serde(flatten)]
    others: BTreeMap<String, IgnoredAny>,
    #[serde(default, rename = "KHR_materials_pbrSpecularGlossiness", deserialize_with = "lenient")]
    specular_glossiness: Option<BaseColor>,
    #[serde(default, rename = "KHR_materials_emissive_strength", deserialize_with = "lenient")]
    emissive_strength: Option<EmissiveStrength>,
    #[serde(default, rename = "KHR_materials_unlit", deserialize_with = "is_there")]
    unlit: bool,
}

/// The share of light that a surface lets through.
#[derive(Debug, Deserialize)]
struct Transmission {
    #[serde(default, alias = "transmissionFactor", alias = "diffuseTransmissionFactor")]
    factor: f32,
}

#[derive(Debug, Deserialize)]
struct EmissiveStrength {
    #[serde(rename = "emissiveStrength")]
    strength: f32,
}

/// The texture, and its set of coordinates.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct GltfTextureInfo {
    pub(crate) index: usize,
    #[serde(default)]
    tex_coord: usize,
    #[serde(default)]
    extensions: InfoExtensions,
}

impl GltfTextureInfo {
    /// The number of its set of coordinates.
    pub(crate) fn set(&self) -> usize {
        self.extensions
            .transform
            .as_ref()
            .and_then(|transform| transform.tex_coord)
            .unwrap_or(self.tex_coord)
    }

    /// A place on the picture, from a vertex' coordinates.
    pub(crate) fn place(&self, at: [f64; 2]) -> [f64; 2] {
        let Some(transform) = &self.extensions.transform else { return at };
        let scale = transform.scale.unwrap_or([1.0; 2]);
        let offset = transform.offset.unwrap_or_default();
        let [u, v] = [at[0] * scale[0], at[1] * scale[1]];
        // Counter-clockwise as seen: v points down.
        let sin = libm::sin(transform.rotation);
        let cos = libm::cos(transform.rotation);
        [cos * u + sin * v + offset[0], cos * v - sin * u + offset[1]]
    }
}

#[derive(Debug, Default, Deserialize)]
struct InfoExtensions {
    #[serde(default, rename = "KHR_texture_transform", deserialize_with = "lenient")]
    transform: Option<TextureTransform>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
struct TextureTransform {
    offset: Option<[f64; 2]>,
    #[serde(default)]
    rotation: f64,
    scale: Option<[f64; 2]>,
    tex_coord: Option<usize>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct GltfTexture {
    /// Number of its PNG or JPEG picture.
    #[serde(default, deserialize_with = "lenient")]
    source: Option<usize>,
    #[serde(default, deserialize_with = "lenient")]
    pub(crate) sampler: Option<usize>,
    #[serde(default)]
    extensions: TextureExtensions,
}

#[derive(Debug, Default, Deserialize)]
struct TextureExtensions {
    #[serde(default, rename = "EXT_texture_webp", deserialize_with = "lenient")]
    webp: Option<PictureSource>,
    #[serde(default, rename = "EXT_texture_avif", deserialize_with = "is_there")]
    avif: bool,
    #[serde(default, rename = "KHR_texture_basisu", deserialize_with = "is_there")]
    basisu: bool,
}

#[derive(Debug, Deserialize)]
struct PictureSource {
    source: usize,
}

impl GltfTexture {
    /// Number of its picture, or the kind of its picture that is not read.
    pub(crate) fn picture(&self) -> Result<usize, &'static str> {
        let readable = self.extensions.webp.as_ref().map(|webp| webp.source).or(self.source);
        readable.ok_or(match &self.extensions {
            TextureExtensions { avif: true, .. } => {
                "only an AVIF picture: convert it to PNG, JPEG or WebP"
            }
            TextureExtensions { basisu: true, .. } => {
                "only a KTX2 picture: convert it to PNG, JPEG or WebP"
            }
            _ => "no picture",
        })
    }
}

/// Filters and wrapping modes, as OpenGL numbers them.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Sampler {
    #[serde(default, deserialize_with = "lenient")]
    mag_filter: Option<u32>,
    #[serde(default, deserialize_with = "lenient")]
    min_filter: Option<u32>,
    #[serde(default, deserialize_with = "lenient")]
    wrap_s: Option<u32>,
    #[serde(default, deserialize_with = "lenient")]
    wrap_t: Option<u32>,
}

impl Sampler {
    /// The filter of its pictures: whatever it is called far away, near texels are what one sees.
    pub(crate) fn filter(&self) -> TexelFilter {
        match (self.mag_filter, self.min_filter) {
            (Some(9728), None | Some(9728 | 9729)) => TexelFilter::Nearest,
            (Some(9728), _) => TexelFilter::NearestOfLevel,
            _ => TexelFilter::Linear,
        }
    }

    pub(crate) fn wrap(&self) -> [Wrap; 2] {
        [self.wrap_s, self.wrap_t].map(|mode| match mode {
            Some(33071) => Wrap::Clamp,
            Some(33648) => Wrap::Mirror,
            _ => Wrap::Repeat,
        })
    }
}

/// A field whose faults are ignored, so that they do not hide a good mesh.
pub(super) fn lenient<'de, D: Deserializer<'de>, T: DeserializeOwned>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    Ok(serde_json::from_value(Value::deserialize(deserializer)?).ok())
}

/// True for a field that is there, with any value.
fn is_there<'de, D: Deserializer<'de>>(deserializer: D) -> Result<bool, D::Error> {
    IgnoredAny::deserialize(deserializer).map(|_| true)
}
