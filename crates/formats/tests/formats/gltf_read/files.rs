//! Small glTF files, made by hand.

use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use trisplat_formats::{ReadOptions, Source, gltf};
use trisplat_scene::{ImportedScene, Result, Scene, mesh::Mesh};

pub(crate) const BYTE: u32 = 5120;
pub(crate) const UNSIGNED_BYTE: u32 = 5121;
pub(crate) const SHORT: u32 = 5122;
pub(crate) const UNSIGNED_SHORT: u32 = 5123;
pub(crate) const UNSIGNED_INT: u32 = 5125;
pub(crate) const FLOAT: u32 = 5126;

/// A document and its binary buffer, growing.
pub(crate) struct Builder {
    pub(crate) json: Value,
    pub(crate) bin: Vec<u8>,
}

impl Builder {
    /// A scene without nodes.
    pub(crate) fn new() -> Self {
        let json = json!({
            "asset": { "version": "2.0", "generator": "by hand" },
            "scene": 0, "scenes": [{ "nodes": [] }],
            "nodes": [], "meshes": [], "accessors": [], "bufferViews": [], "buffers": [{ "byteLength": 0 }],
        });
        Self { json, bin: Vec::new() }
    }

    /// One triangle with a colour per corner and no node transform.
    pub(crate) fn triangle() -> Self {
        let mut b = Self::new();
        let position = b.floats("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
        let color = b.floats("VEC3", &[1., 0., 0., 0., 1., 0., 0., 0., 1.]);
        let mesh = b.mesh(json!({ "attributes": { "POSITION": position, "COLOR_0": color } }));
        b.node(json!({ "mesh": mesh }));
        b
    }

    pub(crate) fn push(&mut self, list: &str, value: Value) -> usize {
        if self.json.get(list).is_none() {
            self.json[list] = json!([]);
        }
        let list = self.json[list].as_array_mut().expect("a list");
        list.push(value);
        list.len() - 1
    }

    /// A view of these bytes, aligned to 4.
    pub(crate) fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let offset = self.bin.len();
        self.bin.extend(bytes);
        self.json["buffers"][0]["byteLength"] = self.bin.len().into();
        self.push(
            "bufferViews",
            json!({ "buffer": 0, "byteOffset": offset, "byteLength": bytes.len() }),
        )
    }

    /// A view of its own and an accessor over all of it.
    pub(crate) fn accessor(
        &mut self,
        component: u32,
        shape: &str,
        count: usize,
        bytes: &[u8],
    ) -> usize {
        let view = self.view(bytes);
        self.push(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "type": shape, "count": count }),
        )
    }

    pub(crate) fn normalized(
        &mut self,
        component: u32,
        shape: &str,
        count: usize,
        bytes: &[u8],
    ) -> usize {
        let accessor = self.accessor(component, shape, count, bytes);
        self.json["accessors"][accessor]["normalized"] = true.into();
        accessor
    }

    pub(crate) fn floats(&mut self, shape: &str, values: &[f32]) -> usize {
        let width = if shape == "SCALAR" { 1 } else { shape[3..].parse().expect("VECn") };
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(FLOAT, shape, values.len() / width, &bytes)
    }

    pub(crate) fn shorts(&mut self, shape: &str, count: usize, values: &[u16]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(UNSIGNED_SHORT, shape, count, &bytes)
    }

    /// A mesh of one primitive.
    pub(crate) fn mesh(&mut self, primitive: Value) -> usize {
        self.push("meshes", json!({ "primitives": [primitive] }))
    }

    /// A node at the root of the scene.
    pub(crate) fn node(&mut self, node: Value) -> usize {
        let node = self.push("nodes", node);
        self.json["scenes"][0]["nodes"].as_array_mut().expect("a list").push(node.into());
        node
    }

    pub(crate) fn glb(&self) -> Vec<u8> {
        glb(&serde_json::to_vec(&self.json).expect("JSON"), &self.bin)
    }

    pub(crate) fn read(&self) -> Result<ImportedScene> {
        read_bytes(&self.glb())
    }

    /// The mesh, with no warnings.
    pub(crate) fn mesh_of(&self) -> Mesh {
        let loaded = self.read().expect("valid");
        assert_eq!(loaded.warnings, Vec::<String>::new());
        mesh(loaded)
    }
}

/// A GLB of these chunks, padded.
pub(crate) fn glb(json: &[u8], bin: &[u8]) -> Vec<u8> {
    let pad = |bytes: &[u8], with: u8| {
        let mut padded = bytes.to_vec();
        padded.resize(bytes.len().next_multiple_of(4), with);
        padded
    };
    let json = pad(json, b' ');
    let bin = pad(bin, 0);
    let mut file = b"glTF\x02\0\0\0".to_vec();
    file.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    for (kind, body) in [(b"JSON", json), (b"BIN\0", bin)] {
        file.extend((body.len() as u32).to_le_bytes());
        file.extend(kind);
        file.extend(body);
    }
    file
}

pub(crate) fn read(path: &Path) -> Result<ImportedScene> {
    gltf::read(Source::open(path, &trisplat_scene::Limits::DEFAULT)?, &ReadOptions::with_degree(0))
}

/// Reads bytes through an unnamed file, which is cheaper to make ten thousand times.
pub(crate) fn read_bytes(bytes: &[u8]) -> Result<ImportedScene> {
    let mut file = tempfile::tempfile().expect("a temporary file");
    std::io::Write::write_all(&mut file, bytes).expect("written");
    std::io::Seek::rewind(&mut file).expect("seekable");
    let source =
        Source { path: PathBuf::from("scene.glb"), file: file.into(), len: bytes.len() as u64 };
    gltf::read(source, &ReadOptions::with_degree(0))
}

pub(crate) fn mesh(loaded: ImportedScene) -> Mesh {
    match loaded.scene {
        Scene::Mesh(mesh) => mesh,
        Scene::Soup(_) => panic!("expected a mesh"),
    }
}
