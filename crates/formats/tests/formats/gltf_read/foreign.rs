//! Files of other programs: transforms, modes, materials, sparse and interleaved data.

use super::files::{
    BYTE, Builder, FLOAT, SHORT, UNSIGNED_BYTE, UNSIGNED_INT, UNSIGNED_SHORT, mesh, read,
    read_bytes,
};
use glam::{DMat4, DQuat, DVec3, Vec3};
use serde_json::{Value, json};
use trisplat_scene::{math::color::linear_from_srgb, mesh::Colors};

fn corners(b: &Builder) -> [Vec3; 3] {
    b.mesh_of().corners(0)
}

#[test]
fn nodes_place_their_meshes() {
    let mut b = Builder::triangle();
    b.json["scenes"][0]["nodes"] = json!([1]);
    let s = std::f32::consts::FRAC_1_SQRT_2;
    b.push(
        "nodes",
        json!({ "children": [2], "translation": [10, 0, 0], "rotation": [0, 0, s, s] }),
    );
    b.push("nodes", json!({ "children": [0], "scale": [2, 3, 4] }));
    let quarter = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
    let m = DMat4::from_rotation_translation(quarter, DVec3::X * 10.0)
        * DMat4::from_scale(DVec3::new(2., 3., 4.));
    let wants = [DVec3::ZERO, DVec3::X, DVec3::Y].map(|p| m.transform_point3(p).as_vec3());
    for (got, wants) in corners(&b).into_iter().zip(wants) {
        assert!(got.distance(wants) < 1e-6, "{got} {wants}");
    }
    // A matrix is column-major.
    b.json["nodes"][1] =
        json!({ "children": [2], "matrix": [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 10, 0, 0, 1] });
    assert_eq!(
        corners(&b),
        [Vec3::new(10., 0., 0.), Vec3::new(10., 2., 0.), Vec3::new(7., 0., 0.)]
    );
}

#[test]
fn a_mirrored_mesh_is_turned_around() {
    let mut b = Builder::triangle();
    b.json["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let got = b.mesh_of();
    assert_eq!(got.corners(0), [Vec3::ZERO, Vec3::Y, Vec3::NEG_X]);
    assert_eq!(got.corner_colors(0), [[1., 0., 0.], [0., 0., 1.], [0., 1., 0.]]);
    let indices = b.shorts("SCALAR", 3, &[0, 1, 2]);
    b.json["meshes"][0]["primitives"][0]["indices"] = indices.into();
    assert_eq!(b.mesh_of().indices, [0, 2, 1]);
}

#[test]
fn materials_say_from_which_sides_triangles_are_drawn() {
    let mut b = Builder::triangle();
    assert_eq!(b.mesh_of().single_sided, [true], "a file that says nothing draws fronts");
    b.push("materials", json!({ "doubleSided": true }));
    b.push("materials", json!({ "doubleSided": false }));
    b.push("materials", json!({ "doubleSided": "a fault" }));
    let plain = b.json["meshes"][0]["primitives"][0].clone();
    let primitive = |material: usize| {
        let mut primitive = plain.clone();
        primitive["material"] = material.into();
        primitive
    };
    b.json["meshes"][0]["primitives"] = (0..3).map(primitive).collect();
    // Mirrored faces are turned around, so that their fronts stay fronts.
    b.json["nodes"][0]["scale"] = json!([-1, 1, 1]);
    let got = b.mesh_of();
    assert_eq!(got.single_sided, [false, true, true]);
    assert!((0..3).all(|face| got.flat_normal(face) == Vec3::Z));
    b.json["meshes"][0]["primitives"].as_array_mut().expect("a list").truncate(1);
    assert!(b.mesh_of().single_sided.is_empty());
}

#[test]
fn a_mesh_shown_twice_is_there_twice() {
    let mut b = Builder::triangle();
    b.node(json!({ "mesh": 0, "translation": [0, 0, 5] }));
    let got = b.mesh_of();
    assert_eq!(got.face_count(), 2);
    assert_eq!(got.corners(1)[1], Vec3::new(1., 0., 5.));
}

#[test]
fn without_scenes_every_root_node_is_shown() {
    let mut b = Builder::triangle();
    b.push("nodes", json!({ "children": [0], "translation": [1, 2, 3] }));
    for key in ["scene", "scenes"] {
        b.json.as_object_mut().expect("an object").remove(key);
    }
    assert_eq!(corners(&b)[0], Vec3::new(1., 2., 3.));
}

#[test]
fn indexed_and_plain_primitives_merge() {
    let mut b = Builder::triangle();
    let position = b.floats("VEC3", &[0., 0., 1., 1., 0., 1., 1., 1., 1., 0., 1., 1.]);
    let color = b.floats("VEC3", &[0.5; 12]);
    b.node(json!({}));
    b.node(json!({ "mesh": 0 }));
    for (component, bytes) in [
        (UNSIGNED_BYTE, vec![0u8, 1, 2, 0, 2, 3]),
        (UNSIGNED_SHORT, [0u16, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect()),
        (UNSIGNED_INT, [0u32, 1, 2, 0, 2, 3].iter().flat_map(|i| i.to_le_bytes()).collect()),
    ] {
        let indices = b.accessor(component, "SCALAR", 6, &bytes);
        let mesh = b.mesh(
            json!({ "attributes": { "POSITION": position, "COLOR_0": color }, "indices": indices }),
        );
        b.json["nodes"][1] = json!({ "mesh": mesh });
        let got = b.mesh_of();
        assert_eq!(got.indices, [0, 1, 2, 3, 4, 5, 3, 5, 6, 7, 8, 9]);
        assert_eq!(got.corner_colors(0)[1], [0., 1., 0.]);
        assert_eq!(got.corner_colors(2), [[0.5; 3]; 3]);
        assert_eq!(got.corners(2)[1], Vec3::new(1., 1., 1.));
    }
}

#[test]
fn flat_faces_stay_flat_until_a_gradient_comes() {
    let mut b = Builder::new();
    for (i, colors) in
        [[0.25; 9], [0.5; 9], [0., 0., 0., 1., 1., 1., 0., 0., 0.]].iter().enumerate()
    {
        let position = b.floats("VEC3", &[i as f32; 9]);
        let color = b.floats("VEC3", colors);
        let mesh = b.mesh(json!({ "attributes": { "POSITION": position, "COLOR_0": color } }));
        b.node(json!({ "mesh": mesh }));
        let got = b.mesh_of();
        match (i, &got.colors) {
            (0, Colors::Face(c)) => assert_eq!(c[..], [[0.25; 3]]),
            (1, Colors::Face(c)) => assert_eq!(c[..], [[0.25; 3], [0.5; 3]]),
            (2, Colors::Vertex(c)) => {
                assert_eq!((c[2], c[3], c[7]), ([0.25; 3], [0.5; 3], [1.0; 3]))
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn strips_and_fans_become_triangles() {
    let mut b = Builder::new();
    let position = b.floats("VEC3", &(0..15).map(|i| i as f32).collect::<Vec<_>>());
    let color = b.floats("VEC3", &[0.5; 15]);
    let stitched = b.shorts("SCALAR", 7, &[0, 1, 2, 2, 3, 3, 4]);
    let attributes = json!({ "POSITION": position, "COLOR_0": color });
    b.mesh(json!({ "attributes": attributes, "mode": 5 }));
    b.node(json!({ "mesh": 0 }));
    assert_eq!(b.mesh_of().indices, [0, 1, 2, 1, 3, 2, 2, 3, 4]);
    b.json["meshes"][0]["primitives"][0]["mode"] = 6.into();
    assert_eq!(b.mesh_of().indices, [1, 2, 0, 2, 3, 0, 3, 4, 0]);
    b.json["meshes"][0]["primitives"][0] =
        json!({ "attributes": attributes, "mode": 5, "indices": stitched });
    assert_eq!(b.mesh_of().indices, [0, 1, 2]);
}

#[test]
fn points_lines_and_odd_corners_are_left_out_with_a_warning() {
    let mut b = Builder::triangle();
    let position = b.floats("VEC3", &[9.0; 12]);
    for mode in 0..4 {
        let mesh = b.mesh(json!({ "attributes": { "POSITION": position }, "mode": mode }));
        b.node(json!({ "mesh": mesh }));
    }
    let loaded = b.read().expect("valid");
    assert_eq!(loaded.warnings, ["points and lines are not read"]);
    assert_eq!(mesh(loaded).face_count(), 1);
    // Four vertices: one face and one too many, before a valid one.
    let mut b = Builder::new();
    let position = b.floats("VEC3", &(0..12).map(|i| i as f32).collect::<Vec<_>>());
    let color = b.floats("VEC3", &[0.5; 12]);
    let odd = b.mesh(json!({ "attributes": { "POSITION": position, "COLOR_0": color } }));
    b.node(json!({ "mesh": odd }));
    b.node(json!({ "mesh": odd, "translation": [100, 0, 0] }));
    let loaded = b.read().expect("valid");
    assert!(loaded.warnings[0].contains("4 corners"), "{:?}", loaded.warnings);
    let got = mesh(loaded);
    assert_eq!((got.face_count(), got.corners(1)[0]), (2, Vec3::new(100., 1., 2.)));
    let Colors::Face(colors) = got.colors else { panic!("expected a colour per face") };
    assert_eq!(colors.len(), 2);
}

#[test]
fn integer_positions_are_placed_by_their_grid() {
    let mut b = Builder::triangle();
    let transform = json!({ "mesh": 0, "scale": [0.5, 0.25, 2], "translation": [1, 2, 3] });
    b.json["nodes"][0] = transform;
    let cases: [(u32, bool, &[u8], Vec3); 6] = [
        (UNSIGNED_SHORT, false, &[0, 1, 0, 2, 0, 4, 0, 0], Vec3::new(256., 512., 1024.)),
        (UNSIGNED_SHORT, true, &[255, 255, 0, 0, 255, 255, 0, 0], Vec3::new(1., 0., 1.)),
        (SHORT, true, &[1, 128, 0, 128, 255, 127, 0, 0], Vec3::new(-1., -1., 1.)),
        (UNSIGNED_BYTE, false, &[1, 2, 3, 0], Vec3::new(1., 2., 3.)),
        (BYTE, true, &[127, 129, 128, 0], Vec3::new(1., -1., -1.)),
        (BYTE, false, &[255, 2, 3, 0], Vec3::new(-1., 2., 3.)),
    ];
    for (component, normalized, bytes, code) in cases {
        let view = b.view(&bytes.repeat(3));
        b.json["bufferViews"][view]["byteStride"] = bytes.len().into();
        let accessor = b.push(
            "accessors",
            json!({ "bufferView": view, "componentType": component, "normalized": normalized, "type": "VEC3", "count": 3 }),
        );
        b.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = accessor.into();
        assert_eq!(
            corners(&b)[1],
            code * Vec3::new(0.5, 0.25, 2.) + Vec3::new(1., 2., 3.),
            "{component} {normalized}"
        );
    }
}

#[test]
fn colours_of_every_type_are_read() {
    let mut b = Builder::triangle();
    let bytes = b.normalized(UNSIGNED_BYTE, "VEC4", 3, &[255, 51, 0, 255].repeat(3));
    let shorts =
        b.normalized(UNSIGNED_SHORT, "VEC4", 3, &[255, 255, 51, 51, 0, 0, 255, 255].repeat(3));
    let short3 = b.normalized(UNSIGNED_SHORT, "VEC3", 3, &[255, 255, 51, 51, 0, 0].repeat(3));
    let floats = b.floats("VEC4", &[1.0, 0.2, 0.0, 1.0].repeat(3));
    for accessor in [bytes, shorts, short3, floats] {
        b.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = accessor.into();
        assert_eq!(b.mesh_of().colors, Colors::Face(vec![[1.0, 0.2, 0.0]]));
    }
    let plain = b.accessor(UNSIGNED_BYTE, "VEC4", 3, &[255; 12]);
    b.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = plain.into();
    assert!(b.read().expect_err("not normalised").to_string().contains("COLOR_0"));
}

#[test]
fn interleaved_attributes_are_taken_apart() {
    let mut b = Builder::new();
    let vertex = |i: u8| {
        [f32::from(i).to_le_bytes(), 0f32.to_le_bytes(), 1f32.to_le_bytes(), [i, 0, 255, 255]]
            .concat()
    };
    // The last vertex lacks nothing; a stride larger than the vertex leaves its padding out.
    let mut bytes: Vec<u8> = (0..3).flat_map(|i| [vertex(i), vec![7; 4]].concat()).collect();
    bytes.truncate(bytes.len() - 4);
    let view = b.view(&bytes);
    b.json["bufferViews"][view]["byteStride"] = 20.into();
    let of = |component: u32, offset: u32, shape: &str, normalized: bool| json!({ "bufferView": 0, "byteOffset": offset, "componentType": component, "type": shape, "count": 3, "normalized": normalized });
    b.push("accessors", of(FLOAT, 0, "VEC3", false));
    b.push("accessors", of(UNSIGNED_BYTE, 12, "VEC4", true));
    b.mesh(json!({ "attributes": { "POSITION": 0, "COLOR_0": 1 } }));
    b.node(json!({ "mesh": 0 }));
    let got = b.mesh_of();
    assert_eq!(got.corners(0), [0., 1., 2.].map(|x| Vec3::new(x, 0., 1.)));
    assert_eq!(got.corner_colors(0)[2], [2.0 / 255.0, 0.0, 1.0]);
    b.json["accessors"][1]["byteOffset"] = 13.into();
    assert!(b.read().is_err(), "one byte past the end");
}

#[test]
fn sparse_accessors_replace_elements() {
    let mut b = Builder::triangle();
    let numbers = b.view(&[2u16.to_le_bytes(), 0u16.to_le_bytes()].concat());
    let values: Vec<u8> =
        [5f32, 6., 7., 8., 9., 10.].iter().flat_map(|v| v.to_le_bytes()).collect();
    let values = b.view(&values);
    let sparse = json!({
        "count": 2,
        "indices": { "bufferView": numbers, "componentType": UNSIGNED_SHORT },
        "values": { "bufferView": values },
    });
    b.json["accessors"][0]["sparse"] = sparse.clone();
    assert_eq!(corners(&b), [Vec3::new(8., 9., 10.), Vec3::X, Vec3::new(5., 6., 7.)]);
    // Over nothing, the rest is zero.
    b.json["accessors"][0].as_object_mut().expect("an object").remove("bufferView");
    assert_eq!(corners(&b), [Vec3::new(8., 9., 10.), Vec3::ZERO, Vec3::new(5., 6., 7.)]);
    for (pointer, bad) in [
        ("/accessors/0/sparse/count", json!(4)),
        ("/accessors/0/sparse/indices/componentType", json!(FLOAT)),
        ("/accessors/0/sparse/indices/bufferView", json!(99)),
        ("/accessors/0/sparse/values/byteOffset", json!(1)),
        ("/accessors/0/count", json!(2)),
    ] {
        let mut broken = Builder { json: b.json.clone(), bin: b.bin.clone() };
        *broken.json.pointer_mut(pointer).unwrap_or(&mut Value::Null) = bad.clone();
        if pointer.ends_with("byteOffset") {
            broken.json["accessors"][0]["sparse"]["values"]["byteOffset"] = bad;
        }
        assert!(broken.read().is_err(), "{pointer}");
    }
}

#[test]
fn materials_tint_and_uncover() {
    let mut b = Builder::triangle();
    b.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    b.push(
        "materials",
        json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.5, 0.25, 1, 0.5] } }),
    );
    let got = b.mesh_of();
    assert_eq!(got.corner_colors(0), [[0.5, 0., 0.], [0., 0.25, 0.], [0., 0., 1.]]);
    assert!(got.opacity.is_empty(), "OPAQUE ignores alpha");
    let colors = b.floats("VEC4", &[1., 1., 1., 0.9, 1., 1., 1., 0.6, 1., 1., 1., 0.3]);
    b.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colors.into();
    for (mode, cutoff, wants) in [
        ("BLEND", json!(null), vec![0.3]),
        ("MASK", json!(null), vec![0.0]),
        ("MASK", json!(0.25), vec![]),
    ] {
        b.json["materials"][0]["alphaMode"] = mode.into();
        b.json["materials"][0]["alphaCutoff"] = cutoff;
        let got = b.mesh_of().opacity;
        assert_eq!(got.len(), wants.len(), "{mode}");
        assert!(
            got.iter().zip(&wants).all(|(a, b): (&f32, &f32)| (a - b).abs() < 1e-6),
            "{mode} {got:?}"
        );
    }
    // Faces of other primitives are opaque.
    b.json["materials"][0]["alphaCutoff"] = json!(null);
    b.json["materials"][0]["alphaMode"] = "BLEND".into();
    let position = b.floats("VEC3", &[3.0; 9]);
    let mesh = b.mesh(json!({ "attributes": { "POSITION": position, "COLOR_0": colors } }));
    b.node(json!({ "mesh": mesh }));
    b.node(json!({ "mesh": 0 }));
    let opacity = b.mesh_of().opacity;
    assert_eq!((opacity.len(), opacity[1]), (3, 1.0));
}

#[test]
fn what_is_not_read_is_warned_of() {
    let mut b = Builder::triangle();
    b.push("materials", json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 }, "baseColorFactor": [0.5, 1, 1, 1] } }));
    b.json["nodes"][0]["skin"] = 0.into();
    b.json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": {} });
    let primitive = &mut b.json["meshes"][0]["primitives"][0];
    primitive["material"] = 0.into();
    primitive["targets"] = json!([{}]);
    primitive["attributes"].as_object_mut().expect("an object").remove("COLOR_0");
    let loaded = b.read().expect("valid");
    for word in [
        "a skin is not applied: skin 0",
        "INSTANCING",
        "morph",
        "a texture is not read",
        "base colour",
    ] {
        let warned =
            loaded.warnings.iter().any(|w| w.to_lowercase().contains(&word.to_lowercase()));
        assert!(warned, "{word}: {:?}", loaded.warnings);
    }
    assert_eq!(mesh(loaded).colors, Colors::Face(vec![[0.5, 1.0, 1.0]]));
}

#[test]
fn colours_out_of_range_are_clamped_and_counted() {
    let mut b = Builder::triangle();
    let colors = b.floats("VEC3", &[1.5, -1., 0., f32::NAN, 0.5, 0.5, 0.5, 0.5, 0.5]);
    b.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colors.into();
    let loaded = b.read().expect("valid");
    assert_eq!(loaded.warnings, ["2 colours lay outside 0 to 1 and were clamped"]);
    assert_eq!(mesh(loaded).corner_colors(0), [[1., 0., 0.], [0., 0.5, 0.5], [0.5; 3]]);
}

#[test]
fn a_material_named_for_godot_has_srgb_colours() {
    let mut b = Builder::triangle();
    let colors = b.floats("VEC3", &[0.5; 9]);
    b.json["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = colors.into();
    b.json["meshes"][0]["primitives"][0]["material"] = 0.into();
    for (name, linear) in
        [("wall", 0.5), ("wall-vcol", linear_from_srgb(0.5)), ("WALL_VCOL", linear_from_srgb(0.5))]
    {
        b.json["materials"] = json!([{ "name": name }]);
        assert_eq!(b.mesh_of().colors, Colors::Face(vec![[linear; 3]]), "{name}");
    }
}

#[test]
fn provenance_of_others_is_their_name_alone() {
    let mut b = Builder::triangle();
    b.json["asset"]["extras"] =
        json!({ "source": "https://example.org", "color_encoding": "u8-srgb" });
    let loaded = b.read().expect("valid");
    assert_eq!(loaded.provenance.generator.as_deref(), Some("by hand"));
    assert_eq!(
        (loaded.provenance.source.as_deref(), loaded.provenance.up),
        (None, Some(trisplat_scene::UpAxis::Y))
    );
}

#[test]
fn buffers_may_be_inline() {
    let b = Builder::triangle();
    let mut json = b.json.clone();
    let digits = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let base64: String = b
        .bin
        .chunks(3)
        .flat_map(|c| {
            let word = c.iter().fold(0u32, |w, b| w << 8 | u32::from(*b)) << (8 * (3 - c.len()));
            (0..=c.len()).map(move |i| char::from(digits[(word >> (18 - 6 * i) & 63) as usize]))
        })
        .collect();
    json["buffers"][0]["uri"] = format!("data:application/octet-stream;base64,{base64}").into();
    let text = serde_json::to_vec_pretty(&json).expect("JSON");
    assert_eq!(mesh(read_bytes(&text).expect("valid")), b.mesh_of());
    for uri in ["data:;base64,AAAA", "data:;base64,A!AA", "data:,abc", "data:;base64"] {
        json["buffers"][0]["uri"] = uri.into();
        assert!(read_bytes(&serde_json::to_vec(&json).expect("JSON")).is_err(), "{uri}");
    }
}

#[test]
fn buffers_elsewhere_are_refused() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.gltf");
    let mut b = Builder::triangle();
    for uri in [
        "https://example.org/a.bin",
        "file:///etc/passwd",
        "/etc/passwd",
        "//host/a",
        "%2Fetc/passwd",
        ".",
        "a%00b",
    ] {
        b.json["buffers"][0]["uri"] = uri.into();
        std::fs::write(&path, b.json.to_string()).expect("written");
        let error = read(&path).expect_err(uri).to_string();
        assert!(error.contains("buffer 0 is at"), "{uri}: {error}");
    }
}

/// The `gltf` crate and this reader agree about a scene with transforms, indices and normalised
/// colours.
#[test]
fn another_reader_sees_the_same() {
    let mut b = Builder::triangle();
    let position = b.floats("VEC3", &(0..30).map(|i| (i as f32 * 0.37).sin()).collect::<Vec<_>>());
    let color = b.normalized(
        UNSIGNED_SHORT,
        "VEC4",
        10,
        &(0..80).map(|i| (i * 37) as u8).collect::<Vec<_>>(),
    );
    let indices = b.shorts("SCALAR", 9, &[0, 9, 3, 4, 1, 2, 8, 7, 6]);
    let mesh = b.mesh(
        json!({ "attributes": { "POSITION": position, "COLOR_0": color }, "indices": indices }),
    );
    b.json["nodes"][0]["children"] = json!([1]);
    b.json["nodes"][0]["rotation"] = json!([0.18257419, 0.36514837, 0.5477226, 0.73029674]);
    b.push("nodes", json!({ "mesh": mesh, "translation": [0.1, 0.2, 0.3], "scale": [1, 2, 3] }));
    let ours = b.mesh_of();
    let theirs = gltf::Gltf::from_slice_without_validation(&b.glb()).expect("valid");
    let blob = theirs.blob.clone().expect("a binary chunk");
    let mut face = 0;
    let mut stack: Vec<_> =
        theirs.default_scene().expect("a scene").nodes().map(|n| (n, DMat4::IDENTITY)).collect();
    while let Some((node, parent)) = stack.pop() {
        let local = DMat4::from_cols_array_2d(&node.transform().matrix().map(|c| c.map(f64::from)));
        let world = parent * local;
        for primitive in node.mesh().iter().flat_map(|m| m.primitives()) {
            let reader = primitive.reader(|_| Some(&blob));
            let positions: Vec<_> = reader.read_positions().expect("positions").collect();
            let colors: Vec<_> = reader.read_colors(0).expect("colours").into_rgb_f32().collect();
            let listed: Option<Vec<u32>> = reader.read_indices().map(|i| i.into_u32().collect());
            let listed = listed.unwrap_or_else(|| (0..positions.len() as u32).collect());
            for corners in listed.chunks_exact(3) {
                for (j, &vertex) in corners.iter().enumerate() {
                    let p = world
                        .transform_point3(Vec3::from(positions[vertex as usize]).as_dvec3())
                        .as_vec3();
                    assert!(ours.corners(face)[j].distance(p) < 1e-5, "face {face}");
                    let c = Vec3::from(ours.corner_colors(face)[j]);
                    assert!(c.distance(Vec3::from(colors[vertex as usize])) < 1e-6, "face {face}");
                }
                face += 1;
            }
        }
        stack.extend(node.children().map(|n| (n, world)));
    }
    assert_eq!(face, ours.face_count());
}

/// A PNG picture of one colour.
fn png(rgb: [u8; 3]) -> Vec<u8> {
    let size = glam::UVec2::splat(2);
    trisplat_scene::image::RgbImage { size, rgb: vec![rgb; 4], alpha: None }
        .to_png()
        .expect("a picture")
}

/// A triangle with a texture of that colour, its corners at `uvs`; returns its mesh.
fn textured(b: &mut Builder, rgb: [u8; 3], uvs: &[f32; 6]) -> usize {
    let view = b.view(&png(rgb));
    let image = b.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
    let texture = b.push("textures", json!({ "source": image }));
    let base = json!({ "baseColorTexture": { "index": texture } });
    let material = b.push("materials", json!({ "pbrMetallicRoughness": base }));
    let position = b.floats("VEC3", &[0., 0., 0., 1., 0., 0., 0., 1., 0.]);
    let uv = b.floats("VEC2", uvs);
    b.push(
        "meshes",
        json!({ "primitives": [{ "attributes": { "POSITION": position, "TEXCOORD_0": uv }, "material": material }] }),
    )
}

#[test]
fn one_picture_is_kept_and_so_are_several() {
    let mut b = Builder::new();
    let mesh = textured(&mut b, [255, 0, 0], &[0., 0., 1., 0., 0., 1.]);
    b.node(json!({ "mesh": mesh }));
    let one = b.read().expect("valid");
    assert!(one.warnings.is_empty(), "{:?}", one.warnings);
    let one = super::files::mesh(one);
    let texture = one.texture.as_ref().expect("kept");
    assert_eq!(texture.uvs, [[glam::Vec2::ZERO, glam::Vec2::X, glam::Vec2::Y]]);
    assert_eq!(one.colors, Colors::Face(vec![[1.0, 0.0, 0.0]]));
    // A mirrored node turns the coordinates around with the corners.
    b.json["nodes"][0]["scale"] = json!([-1, 1, 1]);
    assert_eq!(
        b.mesh_of().texture.expect("kept").uvs,
        [[glam::Vec2::ZERO, glam::Vec2::Y, glam::Vec2::X]]
    );
    // A second picture, repeated.
    let mesh = textured(&mut b, [0, 0, 255], &[5., 5., 6., 5., 5., 6.]);
    b.node(json!({ "mesh": mesh }));
    let two = b.mesh_of();
    assert_eq!(two.texture.as_ref().expect("kept").pages.len(), 2);
    assert_eq!(two.colors, Colors::Face(vec![[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]));
}

#[test]
fn a_picture_that_cannot_be_read_costs_its_colours_only() {
    for (image, why) in [
        (json!({ "bufferView": 0, "mimeType": "image/png" }), "format"),
        (json!({ "bufferView": 99 }), "bufferView 99"),
        (json!({ "uri": "../outside.png" }), "outside"),
        (json!({ "uri": "data:image/png;base64,AAAA" }), "format"),
        (json!({}), "neither"),
    ] {
        let mut b = Builder::new();
        let mesh = textured(&mut b, [255, 0, 0], &[0., 0., 1., 0., 0., 1.]);
        b.node(json!({ "mesh": mesh }));
        b.json["bufferViews"][0]["byteLength"] = 7.into();
        b.json["images"][0] = image;
        let loaded = b.read().expect("the triangle is there");
        let warned =
            loaded.warnings.iter().any(|w| w.contains("a texture is not read") && w.contains(why));
        assert!(warned, "{why}: {:?}", loaded.warnings);
        assert_eq!(super::files::mesh(loaded).colors, Colors::Face(vec![[1.0; 3]]));
    }
}
