//! GLB and glTF as written: read back by the `gltf` crate and by a parser of these tests.

mod parse;
mod scenes;

use glam::Vec3;
use parse::{Parsed, document, parse, stored_color};
use proptest::prelude::*;
use scenes::{any_asset, asset, cut, ramp, strip};
use serde_json::{Value, json};
use std::path::Path;
use trisplat_formats::gltf::{
    ColorEncoding, Container, GltfOptions, PositionEncoding, WrittenGltf, check_size, glb_size,
    stream_offsets, to_glb_bytes, write_glb, write_gltf,
};
use trisplat_scene::{
    Asset, Chunk, Error, Placement, Provenance, Result, UpAxis,
    mesh::{Colors, Mesh},
};

const COLORS: [ColorEncoding; 4] = [
    ColorEncoding::U16Linear,
    ColorEncoding::U8Srgb,
    ColorEncoding::F32Linear,
    ColorEncoding::F32Srgb,
];

fn glb(asset: &Asset, options: &GltfOptions) -> Result<(Vec<u8>, WrittenGltf)> {
    let mut bytes = Vec::new();
    let written = write_glb(&mut bytes, Path::new("scene.glb"), asset, options)?;
    assert_eq!(written.bytes, bytes.len() as u64);
    assert!(to_glb_bytes(asset, options)? == bytes);
    Ok((bytes, written))
}

fn quantised() -> GltfOptions {
    GltfOptions { positions: PositionEncoding::ChunkU16, ..GltfOptions::default() }
}

/// Fails on the first corner that differs, and prints only that one.
fn assert_same(got: &[(Vec3, Vec<u8>)], wants: &[(Vec3, Vec<u8>)]) {
    assert_eq!(got.len(), wants.len());
    for (i, (got, wants)) in got.iter().zip(wants).enumerate() {
        assert_eq!(got, wants, "corner {i}");
    }
}

/// Corners of every face as the file should hold them.
fn expected(mesh: &Mesh, encoding: ColorEncoding) -> Vec<(Vec3, Vec<u8>)> {
    let corner = |f| mesh.corners(f).into_iter().zip(mesh.corner_colors(f));
    (0..mesh.face_count()).flat_map(corner).map(|(p, c)| (p, stored_color(encoding, c))).collect()
}

// ---- what the document says ---------------------------------------------------------------------

#[test]
fn one_chunk_is_a_scene_and_several_are_numbered() {
    let name = |parsed: &Parsed, i: usize| {
        assert_eq!(parsed.list("nodes")[i]["name"], parsed.list("meshes")[i]["name"]);
        parsed.list("nodes")[i]["name"].as_str().unwrap().to_owned()
    };
    let one = parse(&glb(&ramp(5), &GltfOptions::default()).unwrap().0);
    assert_eq!((one.list("nodes").len(), name(&one, 0)), (1, "scene".to_owned()));
    let three = parse(&glb(&cut(ramp(5), 3), &GltfOptions::default()).unwrap().0);
    assert_eq!((three.list("nodes").len(), name(&three, 2)), (3, "chunk_0002".to_owned()));
    // A chunk that pruning left empty, and a mesh that was never chunked.
    let mut gaps = ramp(5);
    gaps.chunks = vec![
        Chunk { first: 0, count: 0 },
        Chunk { first: 0, count: 5 },
        Chunk { first: 5, count: 0 },
    ];
    assert_eq!(parse(&glb(&gaps, &GltfOptions::default()).unwrap().0).list("meshes").len(), 1);
    gaps.chunks.clear();
    assert_eq!(parse(&glb(&gaps, &GltfOptions::default()).unwrap().0).list("meshes").len(), 1);
}

#[test]
fn the_material_is_unlit_double_sided_and_opaque() {
    let options = GltfOptions { material_name: "soup-vcol".into(), ..GltfOptions::default() };
    let parsed = parse(&glb(&ramp(3), &options).unwrap().0);
    let wants = json!([{
        "name": "soup-vcol",
        "alphaMode": "OPAQUE",
        "doubleSided": true,
        "emissiveFactor": [0.0, 0.0, 0.0],
        "pbrMetallicRoughness": {
            "baseColorFactor": [1.0, 1.0, 1.0, 1.0],
            "metallicFactor": 0.0,
            "roughnessFactor": 1.0,
        },
        "extensions": { "KHR_materials_unlit": {} },
    }]);
    assert_eq!(parsed.json["materials"], wants);
    let wants = json!({ "attributes": { "POSITION": 0, "COLOR_0": 1 }, "material": 0 });
    assert_eq!(*parsed.primitive(0), wants);
}

#[test]
fn extensions_are_declared_where_they_are_used_and_nowhere_else() {
    for (positions, meshopt, required) in [
        (PositionEncoding::F32, false, None),
        (PositionEncoding::ChunkU16, false, Some(json!(["KHR_mesh_quantization"]))),
        (PositionEncoding::F32, true, Some(json!(["EXT_meshopt_compression"]))),
        (
            PositionEncoding::ChunkU16,
            true,
            Some(json!(["KHR_mesh_quantization", "EXT_meshopt_compression"])),
        ),
    ] {
        let options = GltfOptions { positions, meshopt, ..GltfOptions::default() };
        let parsed = parse(&glb(&ramp(3), &options).unwrap().0);
        let mut used = vec![json!("KHR_materials_unlit")];
        used.extend(required.iter().flat_map(|r| r.as_array().unwrap().clone()));
        assert_eq!(parsed.json["extensionsUsed"], Value::from(used));
        assert_eq!(parsed.json.get("extensionsRequired"), required.as_ref());
    }
}

#[test]
fn extras_hold_the_provenance_and_the_encodings() {
    let mut asset = ramp(3);
    asset.provenance = Provenance {
        generator: Some("someone 1.0".into()),
        source: Some("größe.ply".into()),
        trainer: None,
        up: Some(UpAxis::Y),
        usual_up: None,
        placement: Placement {
            up: UpAxis::NegY.into(),
            rotate: 0.0,
            scale: 0.1,
            center: [1.0, 2.5, -3.0],
        },
        viewpoint: Some(trisplat_fixtures::VIEWPOINT),
        backdrop_faces: 0,
        exposure: Some([0.5, 0.0, 1.0]),
        cameras: vec![[0.1, -20.5, 3.0, 0.25, -0.5, 0.125, 0.6, 0.4]],
    };
    for colors in COLORS {
        let parsed =
            parse(&glb(&asset, &GltfOptions { colors, ..GltfOptions::default() }).unwrap().0);
        let info = &parsed.json["asset"];
        assert_eq!(info["version"], "2.0");
        assert_eq!(info["generator"], trisplat_scene::report::generator());
        let extras = &info["extras"];
        let back: Provenance = serde_json::from_value(extras.clone()).unwrap();
        assert_eq!(back, asset.provenance);
        assert_eq!(
            serde_json::from_value::<ColorEncoding>(extras["color_encoding"].clone()).unwrap(),
            colors
        );
        assert_eq!(extras["position_encoding"], "f32");
        let note = extras.get("note").and_then(Value::as_str);
        assert_eq!(note.is_some_and(|n| n.contains("sRGB-encoded")), !colors.is_linear());
    }
}

#[test]
fn bounds_are_the_shortest_text_of_the_exact_floats() {
    let asset = cut(ramp(200), 3);
    let parsed = parse(&glb(&asset, &GltfOptions::default()).unwrap().0);
    for (i, chunk) in asset.chunks.iter().enumerate() {
        let run = &asset.mesh.positions
            [3 * chunk.first as usize..3 * (chunk.first + chunk.count) as usize];
        let min = run.iter().fold(Vec3::INFINITY, |a, &b| a.min(b));
        let max = run.iter().fold(Vec3::NEG_INFINITY, |a, &b| a.max(b));
        let accessor = &parsed.list("accessors")[2 * i];
        for (name, wants) in [("min", min), ("max", max)] {
            let read = |axis: usize| accessor[name][axis].as_f64().unwrap() as f32;
            assert_eq!(Vec3::new(read(0), read(1), read(2)), wants);
            let [x, y, z] = wants.to_array();
            let text = format!("\"{name}\":[{x:?},{y:?},{z:?}]");
            assert!(parsed.text.contains(&text), "{text} is not in {}", parsed.text);
        }
    }
}

#[test]
fn zeros_of_either_sign_give_the_same_bound() {
    for (a, b) in [(0.0, -0.0), (-0.0, 0.0), (-0.0, -0.0)] {
        let points = [a, b, a].map(|x| Vec3::new(x, b, 1.0)).to_vec();
        let parsed = parse(
            &glb(&asset(points, Colors::Face(vec![[0.5; 3]]), vec![]), &GltfOptions::default())
                .unwrap()
                .0,
        );
        assert!(
            parsed.text.contains("\"min\":[0.0,0.0,1.0],\"max\":[0.0,0.0,1.0]"),
            "{}",
            parsed.text
        );
    }
}

// ---- what the data says -------------------------------------------------------------------------

#[test]
fn every_color_code_is_stored_exactly_in_every_encoding() {
    for meshopt in [false, true] {
        for colors in COLORS {
            let asset = cut(ramp(300), 4);
            let options = GltfOptions { colors, meshopt, ..GltfOptions::default() };
            let parsed = parse(&glb(&asset, &options).unwrap().0);
            assert_same(&parsed.corners(), &expected(&asset.mesh, colors));
            let normalized = parsed.list("accessors")[1].get("normalized");
            let float = matches!(colors, ColorEncoding::F32Linear | ColorEncoding::F32Srgb);
            assert_eq!(normalized, (!float).then_some(&json!(true)));
        }
    }
}

#[test]
fn sixteen_bits_of_linear_light_hold_every_srgb_code() {
    let parsed = parse(&glb(&ramp(256), &GltfOptions::default()).unwrap().0);
    for (i, stored) in parsed.colors(0).1.iter().enumerate() {
        let red = f32::from(u16::from_le_bytes([stored[0], stored[1]])) / 65535.0;
        assert_eq!(usize::from(trisplat_scene::math::color::srgb8_from_linear(red)), i / 3);
    }
}

#[test]
fn shared_vertices_are_indexed_within_their_chunk() {
    // 65,535 vertices still fit 16 bits (the highest index is 65,534); one more does not.
    for (vertices, kind) in [(7, 5123), (65_535, 5123), (65_536, 5125)] {
        for meshopt in [false, true] {
            let asset = strip(vertices);
            let options = GltfOptions { meshopt, ..GltfOptions::default() };
            let parsed = parse(&glb(&asset, &options).unwrap().0);
            assert_eq!(parsed.list("accessors")[2]["componentType"], kind);
            assert!(
                parsed.stored_positions(0) == asset.mesh.positions,
                "order of the vertices is kept"
            );
            let indices = parsed.indices(0).unwrap();
            assert!(kind == 5125 || !indices.contains(&65_535), "restart value");
            if meshopt {
                // The codec may start a triangle at another corner; winding stays.
                for (got, wants) in indices.chunks(3).zip(asset.mesh.indices.chunks(3)) {
                    let first = got.iter().position(|i| *i == wants[0]).unwrap();
                    assert_eq!([got[first], got[(first + 1) % 3], got[(first + 2) % 3]], wants);
                }
            } else {
                assert!(indices == asset.mesh.indices);
            }
        }
    }
}

#[test]
fn chunks_of_a_shared_mesh_hold_only_the_vertices_they_use() {
    let mut asset = strip(1000);
    asset.mesh.indices.reverse();
    // A vertex that nobody uses must not be written.
    asset.mesh.positions.push(Vec3::splat(1e6));
    let Colors::Vertex(colors) = &mut asset.mesh.colors else { unreachable!() };
    colors.push([0.0; 3]);
    let asset = cut(asset, 7);
    let parsed = parse(&glb(&asset, &GltfOptions::default()).unwrap().0);
    assert_same(&parsed.corners(), &expected(&asset.mesh, ColorEncoding::U16Linear));
    assert!((0..7).all(|i| parsed.stored_positions(i).len() <= 1000 / 7 + 4));
}

#[test]
fn faces_of_one_color_get_vertices_of_their_own() {
    let mut asset = strip(50);
    asset.mesh.colors = ramp(50).mesh.colors;
    let asset = cut(asset, 3);
    for options in [GltfOptions::default(), quantised()] {
        let parsed = parse(&glb(&asset, &options).unwrap().0);
        assert!(parsed.indices(0).is_none());
        let colors =
            |corners: Vec<(Vec3, Vec<u8>)>| corners.into_iter().map(|c| c.1).collect::<Vec<_>>();
        assert_eq!(colors(parsed.corners()), colors(expected(&asset.mesh, options.colors)));
    }
    let parsed = parse(&glb(&asset, &GltfOptions::default()).unwrap().0);
    assert_same(&parsed.corners(), &expected(&asset.mesh, ColorEncoding::U16Linear));
}

#[test]
fn the_reported_error_is_the_one_an_engine_makes() {
    for meshopt in [false, true] {
        let mut asset = cut(ramp(1000), 3);
        // One triangle too small for the grid, one that had no area to begin with.
        asset.mesh.positions[10] = asset.mesh.positions[9] + Vec3::X * 1e-6;
        asset.mesh.positions[11] = asset.mesh.positions[9] + Vec3::Y * 1e-6;
        asset.mesh.positions[13] = asset.mesh.positions[12];
        let (bytes, written) = glb(&asset, &GltfOptions { meshopt, ..quantised() }).unwrap();
        let parsed = parse(&bytes);
        let positions: Vec<Vec3> = (0..3).flat_map(|i| parsed.positions(i)).collect();
        let error = |(a, b): (&Vec3, &Vec3)| a.as_dvec3().distance(b.as_dvec3());
        let worst =
            positions.iter().zip(&asset.mesh.positions).map(error).fold(0.0, f64::max) as f32;
        assert_eq!(written.worst_position_error, worst);
        assert!(worst > 0.0 && worst < 0.5 * 3.0f32.sqrt() * 3.3 / 65535.0 * 1.01, "{worst}");
        assert_eq!(written.collapsed, 1);
        assert!(written.warnings.iter().any(|w| w.contains("flattened 1 of 1000")));
        let accessor = &parsed.list("accessors")[0];
        assert_eq!(
            (&accessor["min"], &accessor["max"]),
            (&json!([0, 0, 0]), &json!([65535, 65535, 65535]))
        );
    }
    assert_eq!(glb(&ramp(9), &GltfOptions::default()).unwrap().1.worst_position_error, 0.0);
}

/// Small triangles on a floor that is one huge triangle: on one grid around all, a fifth of them
/// were flat.
#[test]
fn small_triangles_beside_a_huge_one_keep_their_shape() {
    let small = |i: usize| {
        let at = Vec3::new((i % 141) as f32, 0.5, (i / 141) as f32) * 0.1;
        [at, at + Vec3::X * 0.05, at + Vec3::Y * 0.05]
    };
    let floor = [Vec3::new(-5e4, 0.0, -5e4), Vec3::new(5e4, 0.0, -5e4), Vec3::new(0.0, 0.0, 5e4)];
    let positions: Vec<Vec3> = (0..20_000).flat_map(small).chain(floor).collect();
    let colors = Colors::Face(vec![[0.5; 3]; positions.len() / 3]);
    let mesh = Mesh { positions, colors, ..Mesh::default() };
    // Two chunks: the floor is in the second.
    let asset = cut(Asset { mesh, ..Asset::default() }, 2);
    for meshopt in [false, true] {
        let (bytes, written) = glb(&asset, &GltfOptions { meshopt, ..quantised() }).unwrap();
        assert_eq!((written.collapsed, written.warnings), (0, Vec::new()));
        let parsed = parse(&bytes);
        assert_eq!(parsed.json["extensionsRequired"][0], "KHR_mesh_quantization");
        let positions: Vec<Vec3> = (0..2).flat_map(|i| parsed.positions(i)).collect();
        let error = |(a, b): (&Vec3, &Vec3)| a.as_dvec3().distance(b.as_dvec3());
        let worst = positions.iter().zip(&asset.mesh.positions).map(error).fold(0.0, f64::max);
        // A sixteenth of the size of the median triangle, the root of its area, is allowed.
        let allowed = (0.05f64 * 0.05 / 2.0).sqrt() / 16.0;
        assert!(worst > 0.0 && worst <= allowed, "{worst} of {allowed}");
        let types = [0, 2].map(|i| parsed.list("accessors")[i]["componentType"].as_u64());
        assert_eq!(
            types,
            [Some(5123), Some(5126)],
            "a grid where it is fine enough, floats elsewhere"
        );
    }
}

#[test]
fn the_gltf_crate_reads_it() {
    let asset = cut(ramp(100), 2);
    let (bytes, _) = glb(&asset, &GltfOptions::default()).unwrap();
    let gltf::Gltf { document, blob } = gltf::Gltf::from_slice(&bytes).unwrap();
    let blob = blob.unwrap();
    let mut corners = Vec::new();
    for node in document.default_scene().unwrap().nodes() {
        let primitive = node.mesh().unwrap().primitives().next().unwrap();
        assert!(primitive.material().unlit() && primitive.material().double_sided());
        assert_eq!(primitive.material().alpha_mode(), gltf::material::AlphaMode::Opaque);
        let reader = primitive.reader(|_| Some(&blob));
        assert!(reader.read_indices().is_none() && reader.read_normals().is_none());
        let colors = reader.read_colors(0).unwrap().into_rgba_u16();
        corners
            .extend(reader.read_positions().unwrap().zip(colors).map(|(p, c)| (Vec3::from(p), c)));
        let bounds = primitive.bounding_box();
        let count = 3 * asset.chunks[node.index()].count as usize;
        let own = &corners[corners.len() - count..];
        assert!(
            (0..3).all(|a| own.iter().all(|c| bounds.min[a] <= c.0[a] && c.0[a] <= bounds.max[a]))
        );
    }
    let wants: Vec<(Vec3, Vec<u8>)> = expected(&asset.mesh, ColorEncoding::U16Linear);
    let got = corners.into_iter().map(|(p, c)| (p, bytemuck::cast_slice(&c).to_vec()));
    assert_same(&got.collect::<Vec<_>>(), &wants);
}

#[test]
fn a_gltf_and_its_bin_hold_what_the_glb_holds() {
    let asset = cut(ramp(100), 2);
    for options in [GltfOptions::default(), GltfOptions { meshopt: true, ..quantised() }] {
        let mut text = Vec::new();
        let mut bin = Vec::new();
        let path = Path::new("scene.gltf");
        let written =
            write_gltf(&mut text, &mut bin, "my scene.bin", path, &asset, &options).unwrap();
        assert_eq!(written.bytes, (text.len() + bin.len()) as u64);
        let json: Value = serde_json::from_slice(&text).unwrap();
        assert_eq!(json["buffers"][0]["uri"], "my%20scene.bin");
        assert_eq!(json["buffers"][0]["byteLength"], bin.len());
        let twin = parse(&glb(&asset, &options).unwrap().0);
        assert!(bin == twin.bin);
        assert_same(&document(json, "", &bin).corners(), &twin.corners());
    }
}

#[test]
fn the_bytes_are_the_same_for_any_number_of_threads() {
    let pool = |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    for asset in [cut(ramp(70_000), 5), cut(ramp(70_000), 1), cut(strip(3000), 4)] {
        for positions in [PositionEncoding::F32, PositionEncoding::ChunkU16] {
            for meshopt in [false, true] {
                let options = GltfOptions { positions, meshopt, ..GltfOptions::default() };
                let one = pool(1).install(|| glb(&asset, &options).unwrap());
                assert!(one == pool(2).install(|| glb(&asset, &options).unwrap()));
                assert!(one == pool(7).install(|| glb(&asset, &options).unwrap()));
            }
        }
    }
}

// ---- what is refused ----------------------------------------------------------------------------

#[test]
fn sizes_are_known_before_a_byte_is_written() {
    let path = Path::new("big.glb");
    let size = |triangles: u64| {
        let (starts, bin) = stream_offsets([3 * 12 * triangles, 3 * 8 * triangles].into_iter());
        assert_eq!(starts, [0, 36 * triangles]);
        glb_size(900, bin)
    };
    let check = |container, triangles, allow| check_size(path, container, size(triangles), allow);
    let refused = |r: Result<Option<String>>, limit: u64| match r {
        Err(Error::TooLarge { limit: l, remedy, .. }) => {
            l == limit && remedy.contains("`max_triangles`")
        }
        _ => false,
    };
    let gib1 = (1u64 << 30) / 60;
    let gib2 = (1u64 << 31) / 60;
    let gib4 = (1u64 << 32) / 60;
    for allow in [false, true] {
        assert_eq!(check(Container::Glb, gib1 - 100, allow).unwrap(), None);
        assert!(
            check(Container::Glb, gib1 + 1, allow).unwrap().is_some_and(|w| w.contains("1024 MiB"))
        );
        assert!(refused(check(Container::Glb, gib4 + 1, allow), u32::MAX.into()));
        assert!(
            check(Container::Gltf, gib4 + 1, allow).unwrap().is_some_and(|w| w.contains("2 GiB"))
        );
    }
    assert!(check(Container::Glb, gib2 - 100, false).unwrap().is_some_and(|w| w.contains("1 GiB")));
    assert!(refused(check(Container::Glb, gib2 + 1, false), i32::MAX as u64));
    assert!(check(Container::Glb, gib2 + 1, true).unwrap().is_some_and(|w| w.contains("2 GiB")));
    assert!(check(Container::Glb, gib4 - 100, true).is_ok());
}

#[test]
fn streams_start_on_multiples_of_four() {
    assert_eq!(stream_offsets([6, 4, 1, 0, 8].into_iter()), (vec![0, 8, 12, 16, 16], 24));
    assert_eq!(stream_offsets(std::iter::empty()), (vec![], 0));
}

#[test]
fn nothing_to_write_is_an_error_that_says_what_to_do() {
    for options in [GltfOptions::default(), GltfOptions { meshopt: true, ..quantised() }] {
        let mut out = Vec::new();
        let error =
            write_glb(&mut out, Path::new("scene.glb"), &Asset::default(), &options).unwrap_err();
        assert!(
            error.to_string().contains("no triangle") && error.to_string().contains("prune"),
            "{error}"
        );
        assert!(out.is_empty());
    }
}

#[test]
fn glb_of_an_inconsistent_mesh_is_refused_before_writing() {
    type Damage = fn(&mut Asset);
    let broken: [(&str, Damage); 8] = [
        ("not finite", |a| a.mesh.positions[4].y = f32::NAN),
        ("not finite", |a| a.mesh.positions[8].z = f32::NEG_INFINITY),
        ("color count", |a| a.mesh.colors = Colors::Face(vec![[0.0; 3]; 4])),
        ("color count", |a| a.mesh.colors = Colors::Vertex(vec![[0.0; 3]; 4])),
        ("vertex count", |a| a.mesh.positions.push(Vec3::ZERO)),
        ("index", |a| a.mesh.indices = vec![0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 15]),
        ("chunk 1 begins with face", |a| a.chunks[1].first = 3),
        ("the chunks have", |a| a.chunks[1].count = 2),
    ];
    for (wants, damage) in broken {
        for options in [GltfOptions::default(), GltfOptions { meshopt: true, ..quantised() }] {
            let mut asset = cut(ramp(5), 2);
            damage(&mut asset);
            let mut out = Vec::new();
            let error = write_glb(&mut out, Path::new("scene.glb"), &asset, &options).unwrap_err();
            assert!(
                matches!(error, Error::Invalid { .. } | Error::InvalidData(_))
                    && error.to_string().contains(wants),
                "{error}"
            );
            assert!(out.is_empty());
        }
    }
}

#[test]
fn a_box_too_wide_to_measure_is_refused_only_when_quantising() {
    let points = vec![Vec3::splat(-3e38), Vec3::splat(3e38), Vec3::ZERO];
    let asset = asset(points, Colors::Face(vec![[1.0; 3]]), vec![]);
    assert!(glb(&asset, &GltfOptions::default()).is_ok());
    assert!(glb(&asset, &quantised()).unwrap_err().to_string().contains("extent of scene"));
}

#[test]
fn a_full_disk_is_reported() {
    struct Full(usize);
    impl std::io::Write for Full {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let room = bytes.len().min(self.0);
            self.0 -= room;
            if room == 0 { Err(std::io::ErrorKind::StorageFull.into()) } else { Ok(room) }
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    let asset = ramp(100);
    for room in [0, 11, 500, 2000, 6500] {
        let error =
            write_glb(&mut Full(room), Path::new("x/scene.glb"), &asset, &GltfOptions::default());
        assert!(
            matches!(error, Err(Error::Io { ref path, .. }) if path == Path::new("x/scene.glb")),
            "{room}"
        );
    }
}

// ---- any mesh -----------------------------------------------------------------------------------

proptest! {
    #![proptest_config(trisplat_fixtures::regressions::stored())]

    #[test]
    fn any_mesh_comes_back_as_it_went_in(asset in any_asset(), colors in 0..COLORS.len()) {
        let options = GltfOptions { colors: COLORS[colors], ..GltfOptions::default() };
        let parsed = parse(&glb(&asset, &options).unwrap().0);
        assert_same(&parsed.corners(), &expected(&asset.mesh, options.colors));
        let nodes = parsed.list("nodes").len();
        prop_assert_eq!(nodes, asset.chunks.iter().filter(|c| c.count > 0).count());
        for accessor in parsed.list("accessors") {
            prop_assert!(accessor["count"].as_u64() > Some(0));
        }
    }

    #[test]
    fn any_mesh_comes_back_within_the_reported_error(asset in any_asset(), meshopt in any::<bool>()) {
        let indexed = !asset.mesh.indices.is_empty();
        let (bytes, written) = glb(&asset, &GltfOptions { meshopt, ..quantised() }).unwrap();
        let parsed = parse(&bytes);
        let wants = expected(&asset.mesh, ColorEncoding::U16Linear);
        let got = parsed.corners();
        prop_assert_eq!(got.len(), wants.len());
        // Compressed indices may start a triangle at another corner: compare without order there.
        for (got, wants) in got.chunks(3).zip(wants.chunks(3)) {
            let fits = |first: usize| (0..3).all(|i| {
                let (p, c) = &got[(i + first) % 3];
                let (q, d) = &wants[i];
                let error = p.as_dvec3().distance(q.as_dvec3());
                c == d && error <= f64::from(written.worst_position_error.next_up())
            });
            prop_assert!(fits(0) || (meshopt && indexed && (fits(1) || fits(2))));
        }
    }
}
