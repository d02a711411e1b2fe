//! The JSON document: the glTF objects a triangle scene is made of, and nothing else.
//!
//! Own types rather than those of `gltf-json`: what we do not need is not parsed, so a fault in an
//! animation or a camera does not keep a mesh from being read; indices are plain numbers, checked where
//! they are followed.

use crate::error::{Error, Result};
use serde::de::{Deserializer, Error as _, SeqAccess, Visitor};
use serde::{Deserialize, de::DeserializeOwned};
use serde_json::{Map, Value};
use std::fmt;
use std::marker::PhantomData;
use std::path::Path;

/// Entries of any array of the document. Three bytes of JSON can make a node of 200 bytes.
const MAX_ENTRIES: usize = 1 << 20;

/// A glTF 2.0 document.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Document {
    pub(crate) asset: AssetInfo,
    pub(crate) scene: Option<usize>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) scenes: Vec<Scene>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) nodes: Vec<Node>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) meshes: Vec<Mesh>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) materials: Vec<Material>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) accessors: Vec<Accessor>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) buffer_views: Vec<View>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) buffers: Vec<Buffer>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) extensions_used: Vec<String>,
    #[serde(default, deserialize_with = "few")]
    pub(crate) extensions_required: Vec<String>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct AssetInfo {
    pub(crate) version: String,
    pub(crate) generator: Option<String>,
    pub(crate) extras: Option<Value>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Scene {
    #[serde(default, deserialize_with = "few")]
    pub(crate) nodes: Vec<usize>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Node {
    #[serde(default, deserialize_with = "few")]
    pub(crate) children: Vec<usize>,
    pub(crate) mesh: Option<usize>,
    pub(crate) skin: Option<usize>,
    pub(crate) matrix: Option<[f32; 16]>,
    pub(crate) translation: Option<[f32; 3]>,
    pub(crate) rotation: Option<[f32; 4]>,
    pub(crate) scale: Option<[f32; 3]>,
    #[serde(default)]
    pub(crate) extensions: Map<String, Value>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Mesh {
    #[serde(default, deserialize_with = "few")]
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
    pub(crate) targets: Vec<Value>,
    #[serde(default)]
    pub(crate) extensions: Map<String, Value>,
}

/// Accessor numbers of the attributes we use.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(crate) position: Option<usize>,
    #[serde(rename = "COLOR_0")]
    pub(crate) color: Option<usize>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Material {
    pub(crate) name: Option<String>,
    pub(crate) alpha_mode: Option<String>,
    pub(crate) alpha_cutoff: Option<f32>,
    #[serde(default)]
    pub(crate) pbr_metallic_roughness: BaseColor,
}

#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BaseColor {
    pub(crate) base_color_factor: Option<[f32; 4]>,
    pub(crate) base_color_texture: Option<Value>,
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
    pub(crate) min: Option<Value>,
    pub(crate) max: Option<Value>,
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
pub(crate) struct View {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) byte_length: u64,
    pub(crate) byte_stride: Option<u64>,
    #[serde(default)]
    pub(crate) extensions: ViewExtensions,
}

#[derive(Debug, Default, Deserialize)]
pub(crate) struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression", alias = "KHR_meshopt_compression")]
    pub(crate) meshopt: Option<Compressed>,
}

/// Where a compressed view's bytes are, and what they become.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Compressed {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) byte_length: u64,
    pub(crate) byte_stride: u64,
    pub(crate) count: u64,
    pub(crate) mode: String,
    pub(crate) filter: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Buffer {
    pub(crate) byte_length: u64,
    pub(crate) uri: Option<String>,
}

/// Mode 4, which a primitive has when it names none.
fn triangles() -> u32 {
    4
}

/// The document in `json`.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path, json: &[u8]) -> Result<T> {
    // Writers pad with spaces, some with zeros.
    let end = json.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
    let json = json[..end].strip_prefix(b"\xef\xbb\xbf").unwrap_or(&json[..end]);
    serde_json::from_slice(json).map_err(|e| Error::malformed(path, "JSON", e.to_string()))
}

/// An array of at most [`MAX_ENTRIES`].
fn few<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> std::result::Result<Vec<T>, D::Error> {
    struct Few<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Few<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            write!(f, "an array of at most {MAX_ENTRIES} entries")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> std::result::Result<Vec<T>, A::Error> {
            let mut entries = Vec::new();
            while let Some(entry) = seq.next_element()? {
                if entries.len() == MAX_ENTRIES {
                    return Err(A::Error::invalid_length(entries.len() + 1, &self));
                }
                entries.push(entry);
            }
            Ok(entries)
        }
    }
    deserializer.deserialize_seq(Few(PhantomData))
}
