//! A GLB parser that shares nothing with the writer.

use glam::{U16Vec3, Vec3};
use serde_json::Value;
use trisplat_formats::gltf::ColorEncoding;

pub(crate) struct Parsed {
    pub(crate) json: Value,
    pub(crate) text: String,
    /// Buffer 0, as stored.
    pub(crate) bin: Vec<u8>,
    /// The buffer that the views point into: buffer 0, or what decompression gives.
    decoded: Vec<u8>,
}

fn u32_at(bytes: &[u8], at: usize) -> usize {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize
}

/// Takes a GLB apart and checks the framing rules of the specification on the way.
pub(crate) fn parse(glb: &[u8]) -> Parsed {
    assert_eq!(&glb[..4], b"glTF");
    assert_eq!(u32_at(glb, 4), 2);
    assert_eq!(u32_at(glb, 8), glb.len(), "total length");
    let json_len = u32_at(glb, 12);
    assert_eq!(json_len % 4, 0);
    assert_eq!(&glb[16..20], b"JSON");
    let json = &glb[20..20 + json_len];
    let text = std::str::from_utf8(json).unwrap().trim_end_matches(' ');
    assert!(text.ends_with('}') && json_len - text.len() < 4, "JSON is padded with 0x20");
    let bin_at = 20 + json_len;
    let bin_len = u32_at(glb, bin_at);
    assert_eq!(&glb[bin_at + 4..bin_at + 8], b"BIN\0");
    assert_eq!(bin_at + 8 + bin_len, glb.len(), "nothing after the binary chunk");
    let bin = &glb[bin_at + 8..];
    let json: Value = serde_json::from_str(text).unwrap();
    let byte_length = json["buffers"][0]["byteLength"].as_u64().unwrap() as usize;
    assert!(
        bin_len - byte_length < 4 && bin[byte_length..].iter().all(|&b| b == 0),
        "BIN is padded with 0x00"
    );
    document(json, text, &bin[..byte_length])
}

pub(crate) fn document(json: Value, text: &str, bin: &[u8]) -> Parsed {
    let decoded = decode(&json, bin);
    let parsed = Parsed { json, text: text.to_owned(), bin: bin.to_vec(), decoded };
    parsed.check_references();
    parsed
}

/// Undoes EXT_meshopt_compression with the meshopt crate, when it is used.
fn decode(json: &Value, bin: &[u8]) -> Vec<u8> {
    let Some(buffer) = json["buffers"].get(1) else { return bin.to_vec() };
    assert_eq!(buffer["extensions"]["EXT_meshopt_compression"]["fallback"], true);
    assert!(buffer.get("uri").is_none());
    let mut decoded = vec![0; buffer["byteLength"].as_u64().unwrap() as usize];
    for view in json["bufferViews"].as_array().unwrap() {
        let field = |v: &Value, name: &str| v[name].as_u64().unwrap() as usize;
        let packed = &view["extensions"]["EXT_meshopt_compression"];
        assert_eq!((field(view, "buffer"), field(packed, "buffer")), (1, 0));
        let at = field(packed, "byteOffset");
        let len = field(packed, "byteLength");
        assert_eq!(at % 4, 0);
        let count = field(packed, "count");
        let stride = field(packed, "byteStride");
        let bytes = &bin[at..at + len];
        let raw = if packed["mode"] == "TRIANGLES" {
            assert_eq!(bytes[0], 0xe1, "the index codec of the extension");
            match stride {
                2 => cast(meshopt::decode_index_buffer::<u16>(bytes, count).unwrap()),
                _ => cast(meshopt::decode_index_buffer::<u32>(bytes, count).unwrap()),
            }
        } else {
            assert_eq!(packed["mode"], "ATTRIBUTES");
            assert_eq!(bytes[0], 0xa0, "vertex codec version 0");
            match stride {
                4 => cast(meshopt::decode_vertex_buffer::<[u8; 4]>(bytes, count).unwrap()),
                8 => cast(meshopt::decode_vertex_buffer::<[u8; 8]>(bytes, count).unwrap()),
                12 => cast(meshopt::decode_vertex_buffer::<[u8; 12]>(bytes, count).unwrap()),
                16 => cast(meshopt::decode_vertex_buffer::<[u8; 16]>(bytes, count).unwrap()),
                _ => panic!("stride {stride}"),
            }
        };
        assert_eq!(raw.len(), field(view, "byteLength"));
        let start = field(view, "byteOffset");
        decoded[start..start + raw.len()].copy_from_slice(&raw);
    }
    decoded
}

fn cast<T: bytemuck::NoUninit>(values: Vec<T>) -> Vec<u8> {
    bytemuck::cast_slice(&values).to_vec()
}

impl Parsed {
    pub(crate) fn list(&self, name: &str) -> &[Value] {
        self.json[name].as_array().map_or(&[], Vec::as_slice)
    }

    fn number(value: &Value) -> usize {
        value.as_u64().unwrap() as usize
    }

    /// Everything is used once, views do not overlap, are aligned and inside their buffer, no list
    /// is empty.
    fn check_references(&self) {
        for (name, value) in self.json.as_object().unwrap() {
            assert!(value.as_array().is_none_or(|list| !list.is_empty()), "{name} is empty");
        }
        let buffers = self.list("buffers");
        assert_eq!(self.list("accessors").len(), self.list("bufferViews").len());
        let mut end = 0;
        for (accessor, view) in self.list("accessors").iter().zip(self.list("bufferViews")) {
            let start = Self::number(&view["byteOffset"]);
            let len = Self::number(&view["byteLength"]);
            assert!(start % 4 == 0 && start >= end && start - end < 4);
            end = start + len;
            assert!(end <= Self::number(&buffers[Self::number(&view["buffer"])]["byteLength"]));
            let stride = Self::stride(accessor, view);
            assert_eq!(Self::number(&accessor["count"]) * stride, len);
        }
        let nodes = self.list("nodes");
        // The viewpoint is a node with a camera and without a mesh.
        let drawn = nodes.iter().filter(|node| node.get("camera").is_none());
        let meshes: Vec<usize> = drawn.map(|n| Self::number(&n["mesh"])).collect();
        assert_eq!(meshes, (0..self.list("meshes").len()).collect::<Vec<_>>());
        let roots: Vec<usize> =
            self.json["scenes"][0]["nodes"].as_array().unwrap().iter().map(Self::number).collect();
        assert_eq!(roots, (0..nodes.len()).collect::<Vec<_>>());
    }

    fn stride(accessor: &Value, view: &Value) -> usize {
        let component = match Self::number(&accessor["componentType"]) {
            5121 => 1,
            5123 => 2,
            5125 | 5126 => 4,
            other => panic!("component type {other}"),
        };
        let channels = match accessor["type"].as_str().unwrap() {
            "SCALAR" => 1,
            "VEC3" => 3,
            "VEC4" => 4,
            other => panic!("type {other}"),
        };
        view.get("byteStride").map_or(component * channels, Self::number)
    }

    pub(crate) fn primitive(&self, mesh: usize) -> &Value {
        &self.list("meshes")[mesh]["primitives"][0]
    }

    /// Elements of an accessor: component type and the bytes of each.
    fn elements(&self, accessor: &Value) -> (usize, Vec<Vec<u8>>) {
        let accessor = &self.list("accessors")[Self::number(accessor)];
        let view = &self.list("bufferViews")[Self::number(&accessor["bufferView"])];
        let stride = Self::stride(accessor, view);
        let start = Self::number(&view["byteOffset"]);
        let count = Self::number(&accessor["count"]);
        let elements =
            (0..count).map(|i| self.decoded[start + i * stride..start + (i + 1) * stride].to_vec());
        (Self::number(&accessor["componentType"]), elements.collect())
    }

    /// Positions as stored: floats, or codes.
    pub(crate) fn stored_positions(&self, mesh: usize) -> Vec<Vec3> {
        let (kind, elements) = self.elements(&self.primitive(mesh)["attributes"]["POSITION"]);
        let position = |e: Vec<u8>| match kind {
            5126 => Vec3::from_array(bytemuck::pod_read_unaligned(&e)),
            5123 => {
                assert_eq!(e[6..], [0, 0], "padding is zero");
                U16Vec3::from_array(bytemuck::pod_read_unaligned(&e[..6])).as_vec3()
            }
            other => panic!("component type {other}"),
        };
        elements.into_iter().map(position).collect()
    }

    /// Positions where the node puts them.
    pub(crate) fn positions(&self, mesh: usize) -> Vec<Vec3> {
        let node = &self.list("nodes")[mesh];
        let vec3 = |name: &str, default: f32| {
            let read = |i| node.get(name).map_or(default, |v| v[i].as_f64().unwrap() as f32);
            Vec3::new(read(0), read(1), read(2))
        };
        let scale = vec3("scale", 1.0);
        let translation = vec3("translation", 0.0);
        self.stored_positions(mesh).into_iter().map(|p| scale * p + translation).collect()
    }

    pub(crate) fn colors(&self, mesh: usize) -> (usize, Vec<Vec<u8>>) {
        self.elements(&self.primitive(mesh)["attributes"]["COLOR_0"])
    }

    pub(crate) fn indices(&self, mesh: usize) -> Option<Vec<u32>> {
        let (kind, elements) = self.elements(self.primitive(mesh).get("indices")?);
        let index = |e: Vec<u8>| match kind {
            5123 => u32::from(u16::from_le_bytes(e.try_into().unwrap())),
            5125 => u32::from_le_bytes(e.try_into().unwrap()),
            other => panic!("component type {other}"),
        };
        Some(elements.into_iter().map(index).collect())
    }

    /// Corners of every triangle of every mesh: position and stored colour.
    pub(crate) fn corners(&self) -> Vec<(Vec3, Vec<u8>)> {
        let mut corners = Vec::new();
        for mesh in 0..self.list("meshes").len() {
            let positions = self.positions(mesh);
            let colors = self.colors(mesh).1;
            let count = positions.len() as u32;
            for i in self.indices(mesh).unwrap_or_else(|| (0..count).collect()) {
                corners.push((positions[i as usize], colors[i as usize].clone()));
            }
        }
        corners
    }
}

/// Bytes of a linear colour by the specification, computed in f64 and one corner at a time.
pub(crate) fn stored_color(encoding: ColorEncoding, color: [f32; 3]) -> Vec<u8> {
    let [r, g, b] = color;
    match encoding {
        ColorEncoding::U16Linear => {
            cast([r, g, b, 1.0].map(|x| (f64::from(x) * 65535.0).round() as u16).to_vec())
        }
        ColorEncoding::U8Srgb => vec![code(r), code(g), code(b), 255],
        ColorEncoding::F32Linear => cast(vec![r, g, b, 1.0]),
        ColorEncoding::F32Srgb => {
            let float = |x: f32| {
                let exact = f64::from(code(x)) / 255.0;
                let near = exact as f32;
                if f64::from(near) < exact { near.next_up() } else { near }
            };
            cast(vec![float(r), float(g), float(b), 1.0])
        }
    }
}

/// The nearest sRGB code, in f64: in f32 a value right beside the middle of two codes rounds to the
/// wrong one.
fn code(linear: f32) -> u8 {
    let x = f64::from(linear);
    let encoded = if x <= 0.003_130_8 { 12.92 * x } else { 1.055 * x.powf(1.0 / 2.4) - 0.055 };
    (255.0 * encoded).round() as u8
}
