//! Hostile files: each fails with one clear error or reads, and never panics or fills the memory.

use super::files::{Builder, FLOAT, UNSIGNED_INT, glb, read, read_bytes};
use proptest::prelude::*;
use serde_json::{Value, json};
use std::io::{Seek, SeekFrom, Write};
use std::path::Path;
use trisplat_formats::gltf::{GltfOptions, PositionEncoding, write_glb};
use trisplat_scene::{
    Asset, Chunk,
    mesh::{Colors, Mesh},
};

/// Message with which each edit of a valid file must be refused.
#[test]
fn every_broken_promise_is_named() {
    let max = json!(u64::MAX);
    let cases: Vec<(&str, Value, &str)> = vec![
        ("/asset/version", json!("1.0"), "convert"),
        ("/scene", json!(1), "scene 1"),
        ("/scenes/0/nodes", json!([7]), "node 7"),
        ("/scenes/0/nodes", json!([0, 0]), "two parents"),
        ("/scenes/0/nodes", json!([]), "no triangles"),
        ("/scenes/0/nodes", json!([-1]), "JSON"),
        ("/nodes/0", json!({ "mesh": 0, "children": [0] }), "its own ancestor"),
        ("/nodes/0", json!({ "mesh": 3 }), "mesh 3"),
        (
            "/nodes/0",
            json!({ "mesh": 0, "scale": [1e38, 1e38, 1e38], "translation": [3e38, 0, 0] }),
            "values",
        ),
        ("/nodes/0", json!({ "mesh": 0, "matrix": [1, 2, 3] }), "JSON"),
        ("/meshes/0/primitives/0/attributes/POSITION", json!(9), "accessor 9"),
        ("/meshes/0/primitives/0/attributes/COLOR_0", json!(9), "accessor 9"),
        ("/meshes/0/primitives/0/indices", json!(0), "indices"),
        ("/meshes/0/primitives/0/material", json!(0), "material 0"),
        ("/meshes/0/primitives/0/mode", json!(1), "points and lines"),
        ("/meshes/0/primitives/0/mode", json!(99), "points and lines"),
        ("/accessors/0/componentType", json!(5124), "component type 5124"),
        ("/accessors/0/componentType", json!(UNSIGNED_INT), "POSITION"),
        ("/accessors/0/type", json!("MAT4"), "accessor 0"),
        ("/accessors/0/type", json!("MAT2"), "MAT2"),
        ("/accessors/0/type", json!("VEC2"), "POSITION"),
        ("/accessors/0/bufferView", json!(5), "bufferView 5"),
        ("/accessors/0/bufferView", json!(null), "no bufferView"),
        ("/accessors/0/byteOffset", json!(4), "promises 3 elements from byte 4"),
        ("/accessors/0/byteOffset", max.clone(), "accessor 0"),
        ("/accessors/0/count", json!(4), "promises 4 elements"),
        ("/accessors/0/count", json!(1u64 << 30), "promises 1073741824 elements"),
        ("/accessors/0/count", max.clone(), "promises 18446744073709551615 elements"),
        ("/accessors/0/count", json!(1u64 << 24), "promises 16777216 elements"),
        ("/accessors/1/count", json!(2), "3 positions and 2 colours"),
        ("/bufferViews/0/byteStride", json!(8), "12 bytes per element, 8 bytes apart"),
        ("/bufferViews/0/byteStride", json!(0), "byteStride 0"),
        ("/bufferViews/0/byteStride", max.clone(), "byteStride"),
        ("/bufferViews/0/byteLength", json!(35), "promises 3 elements"),
        ("/bufferViews/0/byteLength", max.clone(), "promises"),
        ("/bufferViews/0/byteOffset", json!(60), "promises"),
        ("/bufferViews/0/byteOffset", max.clone(), "promises"),
        ("/bufferViews/0/buffer", json!(1), "buffer 1"),
        ("/buffers/0/byteLength", json!(80), "truncated"),
        ("/buffers/0/byteLength", json!(1u64 << 40), "truncated"),
        ("/buffers/0/byteLength", json!(71), "promises"),
        ("/extensionsRequired", json!(["VENDOR_magic"]), "VENDOR_magic"),
        ("/asset", json!({}), "JSON"),
        ("/nodes", json!(3), "JSON"),
    ];
    for (pointer, value, wants) in cases {
        let mut b = Builder::triangle();
        let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
        let parent = b.json.pointer_mut(parent).expect("it is there");
        match parent {
            Value::Array(list) => list[key.parse::<usize>().expect("a number")] = value.clone(),
            parent => parent[key] = value.clone(),
        }
        let error = b.read().expect_err(pointer).to_string();
        assert!(error.contains(wants), "{pointer} = {value}: {error}");
    }
}

#[test]
fn indices_must_name_vertices() {
    let mut b = Builder::triangle();
    let indices = b.shorts("SCALAR", 6, &[0, 1, 2, 0, 1, 3]);
    b.json["meshes"][0]["primitives"][0]["indices"] = indices.into();
    let error = b.read().expect_err("3 of 3").to_string();
    assert!(error.contains("vertex 3 in face 1"), "{error}");
}

#[test]
fn draco_is_refused_with_a_remedy() {
    let mut b = Builder::triangle();
    b.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    b.json["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_draco_mesh_compression": {} });
    assert!(b.read().is_ok(), "the plain data are there as well");
    b.json["accessors"][0].as_object_mut().expect("an object").remove("bufferView");
    let error = b.read().expect_err("Draco").to_string();
    assert!(error.contains("Draco") && error.contains("Blender"), "{error}");
}

#[test]
fn containers_must_hold_what_they_say() {
    let valid = Builder::triangle().glb();
    let edit = |at: usize, bytes: &[u8]| {
        let mut file = valid.clone();
        file[at..at + bytes.len()].copy_from_slice(bytes);
        file
    };
    let json_length = u32::from_le_bytes([valid[12], valid[13], valid[14], valid[15]]);
    let bin = 20 + json_length as usize;
    let cases: Vec<(&str, Vec<u8>)> = vec![
        ("binary glTF 1", edit(4, &1u32.to_le_bytes())),
        ("truncated", edit(8, &(valid.len() as u32 + 1).to_le_bytes())),
        ("truncated", edit(8, &u32::MAX.to_le_bytes())),
        ("chunk 0", edit(8, &12u32.to_le_bytes())),
        ("truncated", edit(12, &u32::MAX.to_le_bytes())),
        ("truncated", edit(12, &(json_length - 4).to_le_bytes())),
        ("must come first", edit(16, b"BIN\0")),
        ("truncated", edit(bin, &u32::MAX.to_le_bytes())),
        ("truncated", edit(bin, &8u32.to_le_bytes())),
        ("no uri", edit(bin + 4, b"XXXX")),
        (
            "64 chunks",
            [
                b"glTF\x02\0\0\0".to_vec(),
                820u32.to_le_bytes().to_vec(),
                b"\0\0\0\0JSON".repeat(101),
            ]
            .concat(),
        ),
        ("JSON", b"{".to_vec()),
        ("JSON", b"{}".to_vec()),
        ("JSON", [vec![b'['; 100_000], vec![b']'; 100_000]].concat()),
        (
            "JSON",
            format!(
                "{{\"asset\":{{\"version\":\"2.0\"}},\"nodes\":[{}{{}}]}}",
                "{},".repeat(1 << 20)
            )
            .into_bytes(),
        ),
    ];
    for (wants, file) in cases {
        let error = read_bytes(&file).expect_err(wants).to_string();
        assert!(error.contains(wants), "{wants}: {error}");
    }
}

/// Sizes that are promised over a sparse file of 5 GiB.
#[test]
fn huge_promises_over_a_sparse_file_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("sparse.gltf");
    let bin = std::fs::File::create(folder.path().join("sparse.bin")).expect("writable");
    bin.set_len(5 << 30).expect("sparse");
    let count = (5u64 << 30) / 12;
    let text = json!({
        "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 } }] }],
        "accessors": [{ "bufferView": 0, "componentType": FLOAT, "type": "VEC3", "count": count }],
        "bufferViews": [{ "buffer": 0, "byteLength": 5u64 << 30 }],
        "buffers": [{ "uri": "sparse.bin", "byteLength": 5u64 << 30 }],
    });
    std::fs::write(&path, text.to_string()).expect("written");
    let error = read(&path).expect_err("149 million triangles").to_string();
    assert!(error.contains("`limit` triangles=149130808"), "{error}");
    // A JSON text of 5 GiB.
    let mut file = std::fs::OpenOptions::new().write(true).open(&path).expect("writable");
    file.seek(SeekFrom::Start(5 << 30)).expect("sparse");
    file.write_all(b" ").expect("written");
    let error = read(&path).expect_err("too large").to_string();
    assert!(error.contains("JSON: ") && error.contains("`limit` document_bytes="), "{error}");
}

#[test]
fn small_files_do_not_become_large_scenes() {
    // One mesh shown by many nodes.
    let mut b = Builder::new();
    let position = b.floats("VEC3", &vec![0.0; 3 * 3000]);
    b.mesh(json!({ "attributes": { "POSITION": position } }));
    for _ in 0..4000 {
        b.node(json!({ "mesh": 0 }));
    }
    assert!(b.read().is_err_and(|e| e.to_string().contains("times its size")));
    // A million zeros over nothing.
    let mut b = Builder::triangle();
    let view = b.view(&[0; 12]);
    b.json["accessors"][0] = json!({
        "componentType": FLOAT, "type": "VEC3", "count": 3_000_000,
        "sparse": { "count": 1, "indices": { "bufferView": view, "componentType": 5125 }, "values": { "bufferView": view } },
    });
    assert!(b.read().is_err_and(|e| e.to_string().contains("times its size")));
}

/// The number of copies, which the document says, is checked before any of them is read.
#[test]
fn copies_are_counted_before_they_are_read() {
    let mut b = Builder::triangle();
    let far = b.floats("VEC3", &[f32::INFINITY; 3]);
    b.json["accessors"][far] = json!({ "componentType": FLOAT, "type": "VEC3", "count": 60_000_000,
        "sparse": { "count": 1, "indices": { "bufferView": 999, "componentType": 5125 }, "values": { "bufferView": 999 } } });
    b.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": far } } });
    let strip = b.json["meshes"][0]["primitives"][0].clone();
    b.json["meshes"][0]["primitives"] = json!([strip.clone(), strip]);
    let error = b.read().expect_err("too many triangles").to_string();
    assert!(error.contains("120000000 triangles, the limit is"), "{error}");
    // Nodes that show a mesh of nothing take time only.
    let mut b = Builder::triangle();
    b.json["meshes"][0]["primitives"] = json!(vec![json!({}); 10_000]);
    for _ in 0..10_000 {
        b.node(json!({ "mesh": 0 }));
    }
    let error = b.read().expect_err("too many primitives").to_string();
    assert!(error.contains("triangles, the limit is"), "{error}");
}

/// A compressed triangle: edits of what the extension promises.
#[test]
fn compressed_views_are_checked() {
    let valid = compressed(3);
    let at = "/bufferViews/0/extensions/EXT_meshopt_compression";
    let cases: Vec<(&str, Value)> = vec![
        ("count", json!(u64::MAX)),
        ("count", json!(1 << 20)),
        ("count", json!(2)),
        ("byteStride", json!(3)),
        ("byteStride", json!(0)),
        ("byteStride", json!(252)),
        ("byteStride", json!(u64::MAX)),
        ("byteLength", json!(u64::MAX)),
        ("byteLength", json!(0)),
        ("byteOffset", json!(u64::MAX)),
        ("byteOffset", json!(1)),
        ("buffer", json!(1)),
        ("buffer", json!(9)),
        ("mode", json!("TRIANGLES")),
        ("mode", json!("INDICES")),
        ("mode", json!("OTHER")),
        ("filter", json!("OCTAHEDRAL")),
        ("filter", json!("OTHER")),
    ];
    let (json, bin) = parts(&valid);
    assert!(read_bytes(&glb(json.to_string().as_bytes(), &bin)).is_ok());
    for (key, value) in cases {
        let mut bad = json.clone();
        bad.pointer_mut(at).expect("compressed")[key] = value.clone();
        assert!(read_bytes(&glb(bad.to_string().as_bytes(), &bin)).is_err(), "{key} = {value}");
    }
}

fn scene(faces: usize) -> Asset {
    let positions =
        (0..3 * faces).map(|i| glam::Vec3::new(i as f32, (i * i) as f32, 1.0)).collect();
    let colors = Colors::Face((0..faces).map(|i| [i as f32 / faces as f32; 3]).collect());
    let half = faces as u32 / 2;
    Asset {
        mesh: Mesh { positions, colors, ..Mesh::default() },
        chunks: vec![
            Chunk { first: 0, count: half },
            Chunk { first: half, count: faces as u32 - half },
        ],
        ..Asset::default()
    }
}

fn compressed(faces: usize) -> Vec<u8> {
    let options = GltfOptions {
        meshopt: true,
        positions: PositionEncoding::ChunkU16,
        ..GltfOptions::default()
    };
    let mut bytes = Vec::new();
    write_glb(&mut bytes, Path::new("a.glb"), &scene(faces), &options).expect("written");
    bytes
}

/// The JSON and the binary chunk of a GLB.
fn parts(file: &[u8]) -> (Value, Vec<u8>) {
    let length = u32::from_le_bytes([file[12], file[13], file[14], file[15]]) as usize;
    let json = serde_json::from_slice(&file[20..20 + length]).expect("JSON");
    (json, file[28 + length..].to_vec())
}

#[test]
fn every_prefix_fails_cleanly() {
    let large = {
        let mut bytes = Vec::new();
        write_glb(&mut bytes, Path::new("a.glb"), &scene(4000), &GltfOptions::default())
            .expect("written");
        bytes
    };
    for (file, step) in
        [(Builder::triangle().glb(), 1), (compressed(20), 1), (compressed(4000), 997), (large, 997)]
    {
        for cut in (0..file.len()).step_by(step) {
            assert!(read_bytes(&file[..cut]).is_err(), "{cut} of {} bytes were read", file.len());
        }
    }
}

#[test]
fn every_flipped_bit_fails_or_reads() {
    for file in [Builder::triangle().glb(), compressed(8)] {
        for at in 0..file.len() {
            let mut bad = file.clone();
            bad[at] ^= 1 << (at * 5 % 8);
            drop(read_bytes(&bad));
        }
    }
}

fn fuzz_cases() -> u32 {
    std::env::var("TRISPLAT_FUZZ_CASES").ok().and_then(|v| v.parse().ok()).unwrap_or(64)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: fuzz_cases(), failure_persistence: None, ..Default::default() })]

    #[test]
    fn overwritten_bytes_never_panic(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..10),
        faces in 2usize..40,
    ) {
        let mut file = compressed(faces);
        for (at, value) in edits {
            let at = at.index(file.len());
            file[at] = value;
        }
        drop(read_bytes(&file));
    }

    /// Compressed bytes alone overwritten: the decoder sees them every time.
    #[test]
    fn damaged_streams_never_panic(
        edits in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..10),
        faces in 2usize..200,
    ) {
        let (json, mut bin) = parts(&compressed(faces));
        for (at, value) in edits {
            let at = at.index(bin.len());
            bin[at] = value;
        }
        drop(read_bytes(&glb(json.to_string().as_bytes(), &bin)));
    }

    /// Any number of the document replaced by another.
    #[test]
    fn replaced_numbers_never_panic(
        edits in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![
            0u64..20, Just(u64::MAX), Just(u64::from(u32::MAX)), Just(1 << 62), 5118u64..5128, any::<u64>(),
        ]), 1..4),
        packed in any::<bool>(),
    ) {
        let (mut json, bin) = parts(&if packed { compressed(4) } else { Builder::triangle().glb() });
        for (at, value) in edits {
            let mut numbers = Vec::new();
            list_numbers(&mut json, &mut numbers);
            let at = at.index(numbers.len());
            *numbers.swap_remove(at) = value.into();
        }
        drop(read_bytes(&glb(json.to_string().as_bytes(), &bin)));
    }
}

fn list_numbers<'a>(value: &'a mut Value, numbers: &mut Vec<&'a mut Value>) {
    match value {
        Value::Number(_) => numbers.push(value),
        Value::Array(list) => list.iter_mut().for_each(|v| list_numbers(v, numbers)),
        Value::Object(map) => map.values_mut().for_each(|v| list_numbers(v, numbers)),
        _ => {}
    }
}
