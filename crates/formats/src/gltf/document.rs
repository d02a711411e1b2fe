//! The JSON document as it is read: only the glTF objects of a triangle scene.
//!
//! `gltf-json` has types for all of them, and two are used (the asset, the buffers). The others are this
//! crate's own, because `gltf-json` 1.4 loses information, as shown by tests in
//! `tests/gltf_read/gltf_json.rs`:
//!
//! - Indices, modes and component types are taken modulo 2^32: mesh 4294967296 reads as mesh 0.
//! - A scene without `nodes`, which glTF allows, is refused.
//! - Unknown component types and accessor types are dropped, so a message could not name them.
//! - The whole file must be valid: a fault in an animation, a sampler or a skin hides a good mesh.
//! - Three bytes of JSON (`{}` and a comma) make a material of 752 bytes, and no array has a limit.
//!
//! The crate `gltf` reads through these types, so it loses the same.

use super::extensions::{CompressedView, MESHOPT, MESHOPT_KHR};
use gltf_json::accessor::{self, ComponentType};
use gltf_json::material::AlphaMode;
use gltf_json::mesh;
use gltf_json::validation::Checked;
use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, Error as _, IgnoredAny, SeqAccess, Visitor};
use serde_json::Value;
use serde_json::value::RawValue;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::path::Path;
use trisplat_scene::{Error, Limits, Result, input::BYTE_ORDER_MARK};

/// Names of extensions, without their content.
type Names = BTreeMap<String, IgnoredAny>;

/// A glTF 2.0 document.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Document {
    pub(crate) asset: gltf_json::Asset,
    pub(crate) scene: Option<usize>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) scenes: Vec<Scene>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) nodes: Vec<Node>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) meshes: Vec<Mesh>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) materials: Vec<Material>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) accessors: Vec<Accessor>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) textures: Vec<Texture>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) images: Vec<Image>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) buffer_views: Vec<BufferView>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) buffers: Vec<gltf_json::Buffer>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) extensions_used: Vec<String>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) extensions_required: Vec<String>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Scene {
    #[serde(default, deserialize_with = "limited")]
    pub(crate) nodes: Vec<usize>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Node {
    pub(crate) name: Option<String>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) children: Vec<usize>,
    pub(crate) mesh: Option<usize>,
    pub(crate) skin: Option<usize>,
    pub(crate) matrix: Option<[f64; 16]>,
    pub(crate) translation: Option<[f64; 3]>,
    pub(crate) rotation: Option<[f32; 4]>,
    pub(crate) scale: Option<[f32; 3]>,
    #[serde(default)]
    pub(crate) extensions: Names,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Mesh {
    #[serde(default, deserialize_with = "limited")]
    pub(crate) primitives: Vec<Primitive>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Primitive {
    #[serde(default)]
    pub(crate) attributes: Attributes,
    pub(crate) indices: Option<usize>,
    pub(crate) material: Option<usize>,
    #[serde(default = "triangles")]
    pub(crate) mode: u32,
    #[serde(default)]
    pub(crate) targets: Vec<IgnoredAny>,
    #[serde(default)]
    pub(crate) extensions: Names,
}

/// Accessor numbers of the attributes that are read.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(crate) position: Option<usize>,
    #[serde(rename = "COLOR_0")]
    pub(crate) color: Option<usize>,
    #[serde(rename = "TEXCOORD_0")]
    pub(crate) tex_coord: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Material {
    pub(crate) name: Option<String>,
    pub(crate) alpha_mode: Option<Checked<AlphaMode>>,
    pub(crate) alpha_cutoff: Option<f32>,
    #[serde(default)]
    pub(crate) pbr_metallic_roughness: BaseColor,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BaseColor {
    pub(crate) base_color_factor: Option<[f32; 4]>,
    #[serde(default, deserialize_with = "lenient")]
    pub(crate) base_color_texture: Option<TextureInfo>,
}

/// The texture, and its set of coordinates.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct TextureInfo {
    pub(crate) index: usize,
    #[serde(default)]
    pub(crate) tex_coord: usize,
    #[serde(default)]
    pub(crate) extensions: Names,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Texture {
    /// Number of its PNG or JPEG picture.
    #[serde(default, deserialize_with = "lenient")]
    pub(crate) source: Option<usize>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Image {
    #[serde(default, deserialize_with = "lenient")]
    pub(crate) buffer_view: Option<usize>,
    #[serde(default, deserialize_with = "lenient")]
    pub(crate) uri: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: Option<usize>,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) component_type: u32,
    #[serde(default)]
    pub(crate) normalized: bool,
    pub(crate) count: u64,
    #[serde(rename = "type")]
    pub(crate) shape: String,
    pub(crate) sparse: Option<Sparse>,
}

/// Elements that replace those of an accessor.
#[derive(Debug, Deserialize)]
pub(crate) struct Sparse {
    pub(crate) count: u64,
    pub(crate) indices: SparseIndices,
    pub(crate) values: SparseValues,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseIndices {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) component_type: u32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseValues {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferView {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) byte_length: u64,
    pub(crate) byte_stride: Option<u64>,
    #[serde(default)]
    pub(crate) extensions: ViewExtensions,
}

/// The extension of a view that is followed.
#[derive(Debug, Default)]
pub(crate) struct ViewExtensions {
    pub(crate) meshopt: Option<CompressedView>,
}

impl<'de> Deserialize<'de> for ViewExtensions {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> std::result::Result<Self, D::Error> {
        let mut extensions = BTreeMap::<String, Box<RawValue>>::deserialize(deserializer)?;
        let meshopt = extensions.remove(MESHOPT).or_else(|| extensions.remove(MESHOPT_KHR));
        let parsed = meshopt.map(|text| serde_json::from_str(text.get())).transpose();
        Ok(Self { meshopt: parsed.map_err(D::Error::custom)?.flatten() })
    }
}

/// A field whose faults are ignored, so that they do not hide a good mesh.
fn lenient<'de, D: Deserializer<'de>, T: DeserializeOwned>(
    deserializer: D,
) -> std::result::Result<Option<T>, D::Error> {
    Ok(serde_json::from_value(Value::deserialize(deserializer)?).ok())
}

/// The default mode of a primitive.
fn triangles() -> u32 {
    mesh::TRIANGLES
}

/// The component type of that code.
pub(crate) fn component_type(code: u32) -> Option<ComponentType> {
    Some(match code {
        accessor::BYTE => ComponentType::I8,
        accessor::UNSIGNED_BYTE => ComponentType::U8,
        accessor::SHORT => ComponentType::I16,
        accessor::UNSIGNED_SHORT => ComponentType::U16,
        accessor::UNSIGNED_INT => ComponentType::U32,
        accessor::FLOAT => ComponentType::F32,
        _ => return None,
    })
}

thread_local! {
    /// Most entries of an array in the document being parsed, and the first larger number found. They are
    /// thread-local, because serde passes no context to its functions.
    static ENTRIES: Cell<(u64, Option<u64>)> = const { Cell::new((0, None)) };
}

/// The document in `json`.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path, json: &[u8], limits: &Limits) -> Result<T> {
    // Some writers pad with zeros instead of spaces.
    let end = json.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
    let json = json[..end].strip_prefix(BYTE_ORDER_MARK).unwrap_or(&json[..end]);
    ENTRIES.set((limits.nodes, None));
    let parsed = serde_json::from_slice(json);
    if let (_, Some(beyond)) = ENTRIES.get() {
        limits.nodes(format_args!("{}: JSON", path.display()), beyond)?;
    }
    parsed.map_err(|e| Error::malformed(path, "JSON", e.to_string()))
}

/// An array of at most [`ENTRIES`] entries.
pub(crate) fn limited<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> std::result::Result<Vec<T>, D::Error> {
    struct Limited<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Limited<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("an array")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> std::result::Result<Vec<T>, A::Error> {
            let (most, _) = ENTRIES.get();
            let mut entries = Vec::new();
            while let Some(entry) = seq.next_element()? {
                if entries.len() as u64 == most {
                    ENTRIES.set((most, Some(most + 1)));
                    return Err(A::Error::custom("too many entries"));
                }
                entries.push(entry);
            }
            Ok(entries)
        }
    }
    deserializer.deserialize_seq(Limited(PhantomData))
}
