//! The JSON document: the few glTF objects we write, and nothing that is default or unused.
//!
//! Own types rather than those of `gltf-json`: floats print as the shortest text that reads back as
//! the same f32 (a bound that is off in the last digit is an error to validators), and an object that
//! is not written cannot be written empty.

use super::chunk::{Part, Stream};
use super::{ColorEncoding, Content, GltfOptions, PositionEncoding, all_streams, place};
use crate::asset::Provenance;
use serde::Serialize;

const UNLIT: &str = "KHR_materials_unlit";
const QUANTIZATION: &str = "KHR_mesh_quantization";
const MESHOPT: &str = "EXT_meshopt_compression";

const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

const UNSIGNED_BYTE: u32 = 5121;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const FLOAT: u32 = 5126;

/// A glTF 2.0 document.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Document<'a> {
    asset: AssetInfo<'a>,
    extensions_used: Vec<&'static str>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    extensions_required: Vec<&'static str>,
    scene: usize,
    scenes: [Scene; 1],
    nodes: Vec<Node<'a>>,
    meshes: Vec<Mesh<'a>>,
    materials: [Material<'a>; 1],
    accessors: Vec<Accessor>,
    buffer_views: Vec<BufferView>,
    buffers: Vec<Buffer>,
}

#[derive(Debug, Serialize)]
struct AssetInfo<'a> {
    version: &'static str,
    generator: String,
    extras: Extras<'a>,
}

/// Where the file came from and how it stores things: what a reader needs to undo them.
#[derive(Debug, Serialize)]
struct Extras<'a> {
    #[serde(flatten)]
    provenance: &'a Provenance,
    color_encoding: ColorEncoding,
    position_encoding: PositionEncoding,
    #[serde(skip_serializing_if = "Option::is_none")]
    note: Option<&'static str>,
}

#[derive(Debug, Serialize)]
struct Scene {
    nodes: Vec<usize>,
}

#[derive(Debug, Serialize)]
struct Node<'a> {
    name: &'a str,
    mesh: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    translation: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scale: Option<[f32; 3]>,
}

#[derive(Debug, Serialize)]
struct Mesh<'a> {
    name: &'a str,
    primitives: [Primitive; 1],
}

#[derive(Debug, Default, Serialize)]
struct Primitive {
    attributes: Attributes,
    #[serde(skip_serializing_if = "Option::is_none")]
    indices: Option<usize>,
    material: usize,
}

#[derive(Debug, Default, Serialize)]
struct Attributes {
    #[serde(rename = "POSITION")]
    position: usize,
    #[serde(rename = "COLOR_0")]
    color: usize,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Material<'a> {
    name: &'a str,
    double_sided: bool,
    /// For viewers that do not know unlit: as matt as can be.
    pbr_metallic_roughness: MetallicRoughness,
    extensions: MaterialExtensions,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct MetallicRoughness {
    metallic_factor: f32,
    roughness_factor: f32,
}

#[derive(Debug, Default, Serialize)]
struct MaterialExtensions {
    #[serde(rename = "KHR_materials_unlit")]
    unlit: Unlit,
}

#[derive(Debug, Default, Serialize)]
struct Unlit {}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: usize,
    component_type: u32,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    normalized: bool,
    count: usize,
    #[serde(rename = "type")]
    shape: &'static str,
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    bounds: Option<MinMax>,
}

#[derive(Debug, Serialize)]
#[serde(untagged)]
enum MinMax {
    Float { min: [f32; 3], max: [f32; 3] },
    Code { min: [u16; 3], max: [u16; 3] },
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    byte_offset: u64,
    byte_length: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    byte_stride: Option<u64>,
    target: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    extensions: Option<ViewExtensions>,
}

#[derive(Debug, Serialize)]
struct ViewExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    meshopt: Compressed,
}

/// Where a view's bytes really are.
#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Compressed {
    buffer: usize,
    byte_offset: u64,
    byte_length: u64,
    byte_stride: u64,
    count: usize,
    mode: &'static str,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "camelCase")]
struct Buffer {
    byte_length: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    uri: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    extensions: Option<BufferExtensions>,
}

#[derive(Debug, Serialize)]
struct BufferExtensions {
    #[serde(rename = "EXT_meshopt_compression")]
    meshopt: Fallback,
}

#[derive(Debug, Serialize)]
struct Fallback {
    fallback: bool,
}

impl<'a> Document<'a> {
    /// The document for `content`; `bin_name` is the buffer's file, none in a GLB.
    pub(super) fn new(content: &'a Content, bin_name: Option<&str>) -> Self {
        let Content { asset, options, parts, .. } = content;
        let quantised = options.positions == PositionEncoding::ChunkU16;
        let needed = [(quantised, QUANTIZATION), (options.meshopt, MESHOPT)];
        let required: Vec<_> = needed.into_iter().filter(|(used, _)| *used).map(|(_, name)| name).collect();
        let (buffer_views, buffers) = buffers(content, bin_name);
        let mut accessors = Vec::with_capacity(buffer_views.len());
        let meshes = parts.iter().map(|part| mesh(part, options, &mut accessors)).collect();
        Self {
            asset: AssetInfo {
                version: "2.0",
                generator: crate::report::generator(),
                extras: Extras {
                    provenance: &asset.provenance,
                    color_encoding: options.colors,
                    position_encoding: options.positions,
                    note: (!options.colors.is_linear())
                        .then_some("COLOR_0 is sRGB-encoded, not linear as glTF 2.0 wants: for Godot only"),
                },
            },
            extensions_used: std::iter::once(UNLIT).chain(required.iter().copied()).collect(),
            extensions_required: required,
            scene: 0,
            scenes: [Scene { nodes: (0..parts.len()).collect() }],
            nodes: parts.iter().enumerate().map(|(i, part)| node(i, part)).collect(),
            meshes,
            materials: [Material {
                name: &options.material_name,
                double_sided: true,
                pbr_metallic_roughness: MetallicRoughness { metallic_factor: 0.0, roughness_factor: 1.0 },
                extensions: MaterialExtensions::default(),
            }],
            accessors,
            buffer_views,
            buffers,
        }
    }
}

fn node<'a>(mesh: usize, part: &'a Part) -> Node<'a> {
    Node {
        name: &part.name,
        mesh,
        translation: part.grid.map(|grid| grid.origin.to_array()),
        scale: part.grid.map(|grid| grid.scale.to_array()),
    }
}

/// The mesh of a part; its accessors are appended, one a buffer view.
fn mesh<'a>(part: &'a Part, options: &GltfOptions, accessors: &mut Vec<Accessor>) -> Mesh<'a> {
    let mut primitive = Primitive::default();
    for stream in part.streams() {
        let index = accessors.len();
        match stream {
            Stream::Positions => primitive.attributes.position = index,
            Stream::Colors => primitive.attributes.color = index,
            Stream::Indices => primitive.indices = Some(index),
        }
        accessors.push(accessor(index, part, stream, options));
    }
    Mesh { name: &part.name, primitives: [primitive] }
}

fn accessor(buffer_view: usize, part: &Part, stream: Stream, options: &GltfOptions) -> Accessor {
    let (component_type, shape) = match (stream, options.colors) {
        (Stream::Positions, _) if part.grid.is_some() => (UNSIGNED_SHORT, "VEC3"),
        (Stream::Positions, _) => (FLOAT, "VEC3"),
        (Stream::Colors, ColorEncoding::U16Linear) => (UNSIGNED_SHORT, "VEC4"),
        (Stream::Colors, ColorEncoding::U8Linear | ColorEncoding::U8Srgb) => (UNSIGNED_BYTE, "VEC4"),
        (Stream::Colors, ColorEncoding::F32Linear | ColorEncoding::F32Srgb) => (FLOAT, "VEC4"),
        (Stream::Indices, _) if part.has_short_indices() => (UNSIGNED_SHORT, "SCALAR"),
        (Stream::Indices, _) => (UNSIGNED_INT, "SCALAR"),
    };
    let bounds = (stream == Stream::Positions).then(|| match part.grid {
        Some(grid) => MinMax::Code {
            min: grid.code(part.bounds.min).to_array(),
            max: grid.code(part.bounds.max).to_array(),
        },
        None => MinMax::Float { min: part.bounds.min.to_array(), max: part.bounds.max.to_array() },
    });
    Accessor {
        buffer_view,
        component_type,
        normalized: stream == Stream::Colors && component_type != FLOAT,
        count: part.count(stream),
        shape,
        bounds,
    }
}

/// The views, one a stream, and the buffers: the file's own and, when compressed, the one that exists
/// only once it is decoded.
fn buffers(content: &Content, bin_name: Option<&str>) -> (Vec<BufferView>, Vec<Buffer>) {
    let Content { options, parts, .. } = content;
    let raw = place(all_streams(parts).map(|(part, stream)| part.bytes(stream, options)));
    let views = all_streams(parts).enumerate().map(|(i, (part, stream))| BufferView {
        buffer: usize::from(content.compressed.is_some()),
        byte_offset: raw.0[i],
        byte_length: part.bytes(stream, options),
        byte_stride: (stream == Stream::Positions && part.grid.is_some())
            .then(|| part.stride(stream, options)),
        target: if stream == Stream::Indices { ELEMENT_ARRAY_BUFFER } else { ARRAY_BUFFER },
        extensions: content.compressed.as_ref().map(|streams| ViewExtensions {
            meshopt: Compressed {
                buffer: 0,
                byte_offset: content.starts[i],
                byte_length: streams[i].len() as u64,
                byte_stride: part.stride(stream, options),
                count: part.count(stream),
                mode: if stream == Stream::Indices { "TRIANGLES" } else { "ATTRIBUTES" },
            },
        }),
    });
    let file = Buffer { byte_length: content.bin_bytes, uri: bin_name.map(uri), extensions: None };
    let decoded = Buffer {
        byte_length: raw.1,
        uri: None,
        extensions: Some(BufferExtensions { meshopt: Fallback { fallback: true } }),
    };
    let buffers = std::iter::once(file).chain(options.meshopt.then_some(decoded)).collect();
    (views.collect(), buffers)
}

/// A file name as a relative URI reference (RFC 3986): everything but unreserved characters escaped.
pub(crate) fn uri(name: &str) -> String {
    let mut uri = String::with_capacity(name.len());
    for byte in name.bytes() {
        if byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) {
            uri.push(char::from(byte));
        } else {
            uri.push_str(&format!("%{byte:02X}"));
        }
    }
    uri
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_names_become_uris() {
        assert_eq!(uri("scene-1_a.bin"), "scene-1_a.bin");
        assert_eq!(uri("my scene#2.bin"), "my%20scene%232.bin");
        assert_eq!(uri("größe.bin"), "gr%C3%B6%C3%9Fe.bin");
    }
}
