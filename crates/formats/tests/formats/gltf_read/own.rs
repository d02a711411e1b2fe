//! Written files read back: every colour and position encoding, compressed or not, chunked,
//! indexed.

use super::files::{glb, mesh, read, read_bytes};
use glam::Vec3;
use proptest::prelude::*;
use std::path::Path;
use trisplat_formats::gltf::{ColorEncoding, GltfOptions, PositionEncoding, write_glb, write_gltf};
use trisplat_raster::solid::view_colors;
use trisplat_scene::{
    Asset, Chunk, FaceSh, Placement, Provenance, Rng, UpAxis,
    math::color::{linear_from_srgb, srgb_from_linear},
    mesh::{Colors, Mesh},
};

const COLORS: [ColorEncoding; 4] = [
    ColorEncoding::U16Linear,
    ColorEncoding::U8Srgb,
    ColorEncoding::F32Linear,
    ColorEncoding::F32Srgb,
];

/// Soup-like triangles: one 8-bit sRGB colour each.
fn soup(faces: usize) -> Asset {
    let rng = Rng::new(7, "gltf_read", 0);
    let at =
        |i: usize| Vec3::from([0, 1, 2].map(|c| rng.uniform((3 * i + c) as u64) * 20.0 - 10.0));
    let small = |i: usize| at(i / 3) + 0.05 * at(i + 100_000);
    let code = |i: usize, c: usize| linear_from_srgb(((i * 31 + c * 97) % 256) as f32 / 255.0);
    let mesh = Mesh {
        positions: (0..3 * faces).map(small).collect(),
        colors: Colors::Face((0..faces).map(|i| [code(i, 0), code(i, 1), code(i, 2)]).collect()),
        ..Mesh::default()
    };
    Asset { mesh, ..Asset::default() }
}

/// A connected grid with a colour per vertex.
fn sheet(side: u32) -> Asset {
    let vertex =
        |i: u32| Vec3::new((i % side) as f32 * 0.1, (i / side) as f32 * 0.3, (i as f32).sin());
    let quad = |i: u32| [i, i + 1, i + side, i + 1, i + side + 1, i + side];
    let indices = (0..side * (side - 1)).filter(|i| i % side != side - 1).flat_map(quad).collect();
    let color = |i: u32| [0.0, i as f32 / (side * side) as f32, 1.0];
    let mesh = Mesh {
        positions: (0..side * side).map(vertex).collect(),
        colors: Colors::Vertex((0..side * side).map(color).collect()),
        indices,
        opacity: Vec::new(),
        ..Mesh::default()
    };
    Asset { mesh, ..Asset::default() }
}

fn chunked(mut asset: Asset, size: u32) -> Asset {
    let faces = asset.mesh.face_count() as u32;
    let starts = (0..faces).step_by(size as usize);
    asset.chunks = starts.map(|first| Chunk { first, count: size.min(faces - first) }).collect();
    asset
}

fn round_trip(asset: &Asset, options: &GltfOptions) -> Mesh {
    let mut bytes = Vec::new();
    write_glb(&mut bytes, Path::new("scene.glb"), asset, options).expect("written");
    let loaded = read_bytes(&bytes).expect("read back");
    assert_eq!(loaded.warnings, Vec::<String>::new());
    mesh(loaded)
}

/// Largest difference of two colours after the inverse conversion, in 8-bit sRGB codes.
fn codes_apart(a: [f32; 3], b: [f32; 3]) -> f32 {
    let apart = |(a, b)| (srgb_from_linear(a) - srgb_from_linear(b)).abs() * 255.0;
    a.into_iter().zip(b).map(apart).fold(0.0, f32::max)
}

#[test]
fn soups_come_back_as_soups_in_every_encoding() {
    for asset in [soup(500), chunked(soup(500), 64)] {
        for colors in COLORS {
            for meshopt in [false, true] {
                let options = GltfOptions { colors, meshopt, ..GltfOptions::default() };
                let back = round_trip(&asset, &options);
                assert_eq!(back.positions, asset.mesh.positions, "{options:?}");
                assert!(back.indices.is_empty() && back.opacity.is_empty());
                let (Colors::Face(got), Colors::Face(wants)) = (&back.colors, &asset.mesh.colors)
                else {
                    panic!("expected a colour per face");
                };
                let worst =
                    got.iter().zip(wants).map(|(a, b)| codes_apart(*a, *b)).fold(0.0, f32::max);
                assert!(got.len() == wants.len() && worst < 0.03, "{options:?}: {worst} codes");
            }
        }
    }
}

#[test]
fn what_comes_back_is_written_as_the_same_bytes() {
    for colors in COLORS {
        let options = GltfOptions { colors, ..GltfOptions::default() };
        let bytes = |asset: &Asset| {
            let mut bytes = Vec::new();
            write_glb(&mut bytes, Path::new("scene.glb"), asset, &options).expect("written");
            bytes
        };
        let first = bytes(&soup(300));
        let back = mesh(read_bytes(&first).expect("read back"));
        assert_eq!(bytes(&Asset { mesh: back, ..Asset::default() }), first, "{colors:?}");
    }
}

#[test]
fn chunk_local_positions_come_back_where_an_engine_puts_them() {
    for asset in [chunked(soup(900), 128), chunked(sheet(20), 100)] {
        for meshopt in [false, true] {
            let options = GltfOptions {
                positions: PositionEncoding::ChunkU16,
                meshopt,
                ..GltfOptions::default()
            };
            let mut bytes = Vec::new();
            let written =
                write_glb(&mut bytes, Path::new("scene.glb"), &asset, &options).expect("written");
            let back = mesh(read_bytes(&bytes).expect("read back"));
            let worst = (0..asset.mesh.face_count())
                .flat_map(|f| asset.mesh.corners(f).map(|p| (p, back.corners(f))))
                // meshopt may start a face at another corner.
                .map(|(p, corners)| {
                    corners.map(|q| p.distance(q)).into_iter().fold(f32::MAX, f32::min)
                })
                .fold(0.0, f32::max);
            // The writer reports the error in the engine's f32 arithmetic; ours rounds once.
            assert!(worst <= written.worst_position_error * 1.01 + 1e-6, "{worst} {written:?}");
            assert!(worst > 0.0);
        }
    }
}

#[test]
fn connected_meshes_stay_connected() {
    let sheet = sheet(12);
    for meshopt in [false, true] {
        let options =
            GltfOptions { colors: ColorEncoding::F32Linear, meshopt, ..GltfOptions::default() };
        let back = round_trip(&sheet, &options);
        assert_eq!(back.positions, sheet.mesh.positions);
        assert_eq!(back.colors, sheet.mesh.colors);
        // meshopt may start a face at another corner.
        let turned = |face: [u32; 3]| {
            let first = (0..3).min_by_key(|&i| face[i]).expect("three");
            [face[first], face[(first + 1) % 3], face[(first + 2) % 3]]
        };
        for face in 0..sheet.mesh.face_count() {
            assert_eq!(turned(back.face(face)), turned(sheet.mesh.face(face)), "face {face}");
        }
    }
}

#[test]
fn a_document_with_a_buffer_beside_it_is_the_same_scene() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("my scene.gltf");
    let name = "my scene & ü.bin";
    let asset = chunked(soup(70), 32);
    let mut json = Vec::new();
    let mut bin = Vec::new();
    write_gltf(&mut json, &mut bin, name, &path, &asset, &GltfOptions::default()).expect("written");
    std::fs::write(&path, &json).expect("written");
    let error = read(&path).expect_err("no buffer yet").to_string();
    assert!(error.contains(name), "{error}");
    std::fs::write(folder.path().join(name), &bin).expect("written");
    assert_eq!(mesh(read(&path).expect("whole")).positions, asset.mesh.positions);
    std::fs::write(folder.path().join(name), &bin[..bin.len() - 1]).expect("written");
    let error = read(&path).expect_err("cut").to_string();
    assert!(error.contains("truncated"), "{error}");
}

#[test]
fn the_provenance_comes_back() {
    let mut asset = soup(3);
    asset.provenance = Provenance {
        generator: Some("trisplat 0.0.1".into()),
        source: Some("room.ply".into()),
        trainer: Some("someone".into()),
        up: Some(UpAxis::Y),
        usual_up: None,
        placement: Placement {
            up: UpAxis::NegY.into(),
            rotate: 0.0,
            scale: 0.1,
            center: [1.0, 2.5, -3.25],
        },
        viewpoint: Some(trisplat_fixtures::VIEWPOINT),
        backdrop_faces: 0,
        exposure: Some([0.5, 0.0, 1.0]),
        cameras: vec![[0.1, -20.5, 3.0, 0.25, -0.5, 0.125, 0.6, 0.4]],
    };
    let mut bytes = Vec::new();
    write_glb(&mut bytes, Path::new("scene.glb"), &asset, &GltfOptions::default())
        .expect("written");
    assert_eq!(read_bytes(&bytes).expect("read back").provenance, asset.provenance);
}

#[test]
fn single_sided_faces_have_their_material_and_order() {
    for (asset, cuts) in
        [(soup(60), 1), (chunked(soup(60), 20), 3), (sheet(6), 1), (chunked(sheet(6), 20), 3)]
    {
        for meshopt in [false, true] {
            let mut asset = asset.clone();
            let faces = asset.mesh.face_count();
            asset.mesh.single_sided = (0..faces).map(|face| face % 20 >= 14).collect();
            let options = GltfOptions {
                meshopt,
                material_name: "trisplat-vcol".into(),
                ..GltfOptions::default()
            };
            let mut bytes = Vec::new();
            write_glb(&mut bytes, Path::new("scene.glb"), &asset, &options).expect("written");
            let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
            let json: serde_json::Value =
                serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
            let materials = json["materials"].as_array().expect("a list");
            let name = |i: usize| materials[i]["name"].as_str().expect("a name");
            let sides = |i: usize| materials[i]["doubleSided"].as_bool().unwrap_or(false);
            assert_eq!((name(0), sides(0)), ("trisplat-vcol", true));
            assert_eq!((name(1), sides(1)), ("trisplat_front-vcol", false));
            let runs = asset.mesh.single_sided.chunk_by(|a, b| a == b).count();
            assert!(runs > cuts && materials.len() == 2);
            assert_eq!(
                json["meshes"].as_array().map(Vec::len),
                Some(runs),
                "each node has one material"
            );
            let nodes = json["nodes"].as_array().expect("a list");
            assert!(
                nodes
                    .iter()
                    .all(|node| node["name"].as_str().is_some_and(|n| n.starts_with("chunk_")))
            );
            let back = read_bytes(&bytes).expect("read back");
            assert_eq!(mesh(back).single_sided, asset.mesh.single_sided);
        }
    }
}

#[test]
fn a_scene_of_one_chunk_has_a_node_for_each_of_its_sides() {
    let mut asset = soup(9);
    let names = |asset: &Asset| {
        trisplat_formats::gltf::to_glb_bytes(asset, &GltfOptions::default())
            .map(|bytes| {
                let length =
                    u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
                let json: serde_json::Value =
                    serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
                let nodes = json["nodes"].as_array().expect("a list");
                nodes
                    .iter()
                    .map(|node| node["name"].as_str().expect("a name").to_owned())
                    .collect::<Vec<_>>()
            })
            .expect("written")
    };
    assert_eq!(names(&asset), ["scene"]);
    asset.mesh.single_sided = (0..9).map(|face| face >= 5).collect();
    assert_eq!(names(&asset), ["scene", "scene_front"]);
    asset.mesh.single_sided = vec![true; 9];
    assert_eq!(names(&asset), ["scene"]);
}

#[test]
fn a_scene_of_single_sided_faces_has_one_material() {
    let mut asset = soup(9);
    asset.mesh.single_sided = vec![true; 9];
    let back = round_trip(&asset, &GltfOptions::default());
    assert_eq!(back.single_sided, vec![true; 9]);
    asset.mesh.single_sided = vec![false; 9];
    assert!(round_trip(&asset, &GltfOptions::default()).single_sided.is_empty());
}

#[test]
fn a_backdrop_is_a_node_of_its_own_and_comes_back_last() {
    let cuts = [
        vec![],
        vec![Chunk { first: 0, count: 7 }, Chunk { first: 7, count: 2 }],
        vec![
            Chunk { first: 0, count: 4 },
            Chunk { first: 4, count: 3 },
            Chunk { first: 7, count: 2 },
        ],
    ];
    for chunks in cuts {
        let mut asset = soup(9);
        asset.provenance.backdrop_faces = 2;
        asset.mesh.single_sided = (0..9).map(|face| face >= 7).collect();
        asset.chunks = chunks;
        for (material_name, wants) in [("trisplat", "backdrop"), ("trisplat-vcol", "backdrop-vcol")]
        {
            let options = GltfOptions {
                material_name: material_name.into(),
                colors: ColorEncoding::F32Linear,
                ..GltfOptions::default()
            };
            let mut bytes = Vec::new();
            write_glb(&mut bytes, Path::new("scene.glb"), &asset, &options).expect("written");
            let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
            let json: serde_json::Value =
                serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
            let last =
                |list: &str| json[list].as_array().and_then(|l| l.last().cloned()).expect("some");
            assert_eq!(
                (&last("nodes")["name"], &last("meshes")["name"]),
                (&"backdrop".into(), &"backdrop".into())
            );
            let material =
                last("meshes")["primitives"][0]["material"].as_u64().expect("a material");
            assert_eq!((material, json["materials"].as_array().map(Vec::len)), (1, Some(2)));
            assert_eq!(json["materials"][1]["name"], wants);
            let sides =
                [0, 1].map(|i| json["materials"][i]["doubleSided"].as_bool().unwrap_or(false));
            assert_eq!(sides, [true, false]);
            let others = json["meshes"].as_array().map_or(0, Vec::len) - 1;
            assert!((0..others).all(|i| json["meshes"][i]["primitives"][0]["material"] == 0));
            if material_name == "trisplat" {
                let back = read_bytes(&bytes).expect("read back");
                assert_eq!((back.provenance.backdrop_faces, &mesh(back)), (2, &asset.mesh));
            }
        }
    }
    let mut across = soup(9);
    across.provenance.backdrop_faces = 2;
    across.chunks = vec![Chunk { first: 0, count: 8 }, Chunk { first: 8, count: 1 }];
    let error =
        write_glb(&mut Vec::new(), Path::new("scene.glb"), &across, &GltfOptions::default());
    assert!(error.is_err_and(|e| e.to_string().contains("both the scene and the backdrop")));
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, failure_persistence: None, ..Default::default() })]

    /// f32 positions and colours survive bit for bit, whatever they are and however they are cut.
    #[test]
    fn float_files_are_exact(
        points in prop::collection::vec(any::<[f32; 3]>(), 9..90),
        channels in prop::collection::vec(0.0f32..=1.0, 90),
        chunk in 1u32..9,
        by_face in any::<bool>(),
    ) {
        let faces = points.len() / 3;
        let finite = |x: f32| if x.is_finite() { x } else { 0.5 };
        let positions: Vec<Vec3> = points[..3 * faces].iter().map(|p| Vec3::from(p.map(finite))).collect();
        let color = |i: usize| [channels[i], channels[(i + 30) % 90], channels[(i + 60) % 90]];
        let colors = if by_face {
            Colors::Face((0..faces).map(color).collect())
        } else {
            Colors::Vertex((0..3 * faces).map(color).collect())
        };
        let mesh = Mesh { positions, colors, ..Mesh::default() };
        let asset = chunked(Asset { mesh, ..Asset::default() }, chunk);
        let options = GltfOptions { colors: ColorEncoding::F32Linear, ..GltfOptions::default() };
        let back = round_trip(&asset, &options);
        let bits = |m: &Mesh| m.positions.iter().map(|p| p.to_array().map(f32::to_bits)).collect::<Vec<_>>();
        prop_assert_eq!(bits(&back), bits(&asset.mesh));
        for face in 0..faces {
            prop_assert_eq!(back.corner_colors(face), asset.mesh.corner_colors(face));
        }
    }
}

/// A soup with harmonics of degree 2, whose last triangle is the backdrop.
fn shiny(faces: usize) -> Asset {
    let mut asset = soup(faces);
    let value = |i: usize| 0.01 * ((i * 29 % 83) as f32 - 41.0);
    let coefficients = (0..9 * faces).map(|i| [value(i), value(i + 1), value(i + 2)]).collect();
    asset.mesh.sh = Some(FaceSh::new(2, coefficients).unwrap());
    asset.provenance.backdrop_faces = 1;
    asset
}

#[test]
fn harmonics_read_back_with_every_storage_of_positions() {
    for asset in [shiny(301), chunked(shiny(301), 60)] {
        for positions in [PositionEncoding::F32, PositionEncoding::ChunkU16] {
            for meshopt in [false, true] {
                let options = GltfOptions { positions, meshopt, ..GltfOptions::default() };
                let back = round_trip(&asset, &options);
                let [own, read] = [&asset.mesh, &back].map(|mesh| mesh.sh.as_ref().unwrap());
                let scene = asset.scene_faces();
                assert_eq!((read.degree(), read.face_count()), (2, scene + 1));
                for face in 0..scene {
                    for (a, b) in own.face(face).iter().zip(read.face(face)) {
                        let apart = (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max);
                        assert!(apart <= 0.51 * 0.41 / 127.0, "{face}: {a:?} {b:?}");
                    }
                }
                assert_eq!(read.face(scene), [[0.0; 3]; 9], "the backdrop has none");
            }
        }
    }
}

/// A scene that editors turned, enlarged and mirrored shows from there what it showed before.
#[test]
fn harmonics_turn_with_the_node_of_their_mesh() {
    let asset = shiny(12);
    let mut bytes = Vec::new();
    write_glb(&mut bytes, Path::new("scene.glb"), &asset, &GltfOptions::default()).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let read = |node: serde_json::Value| {
        let mut json = json.clone();
        for (key, value) in node.as_object().unwrap() {
            json["nodes"][0][key] = value.clone();
        }
        let json = serde_json::to_vec(&json).unwrap();
        read_bytes(&glb(&json, &bytes[28 + length..])).unwrap()
    };
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // A quarter of a turn about x, twice as large, x mirrored.
    let turned = serde_json::json!({ "rotation": [half, 0.0, 0.0, half], "scale": [-2, 2, 2] });
    let moved = |p: Vec3| Vec3::new(-2.0 * p.x, -2.0 * p.z, 2.0 * p.y);
    let [own, turned] = [serde_json::json!({}), turned].map(|node| mesh(read(node)));
    assert!(turned.positions[0].distance(moved(own.positions[0])) < 1e-4);
    for eye in [Vec3::new(40.0, 3.0, -9.0), Vec3::new(-4.0, -50.0, 30.0)] {
        let [own, turned] =
            [(&own, eye), (&turned, moved(eye))].map(|(mesh, eye)| view_colors(mesh, eye).unwrap());
        let (Colors::Vertex(own), Colors::Vertex(turned)) = (own, turned) else { panic!() };
        // Mirrored faces have their corners in the other order.
        let apart =
            own.iter().step_by(3).zip(turned.iter().step_by(3)).map(|(own, turned)| {
                (0..3).map(|c| (own[c] - turned[c]).abs()).fold(0.0, f32::max)
            });
        assert!(apart.fold(0.0, f32::max) < 1e-4);
    }
    let sheared =
        serde_json::json!({ "matrix": [1, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1] });
    let sheared = read(sheared);
    assert!(sheared.warnings.iter().any(|warning| warning.contains("shears")));
    assert!(mesh(sheared).sh.is_none());
}

#[test]
fn harmonics_leave_the_plain_look_as_it_is() {
    let asset = shiny(40);
    let mut bytes = Vec::new();
    let options = GltfOptions::default();
    write_glb(&mut bytes, Path::new("scene.glb"), &asset, &options).unwrap();
    let length = u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).unwrap();
    let [scene, backdrop] = [0, 1].map(|i| &json["materials"][i]);
    assert_eq!(scene["occlusionTexture"]["strength"], 0.0);
    assert_eq!(scene["extras"]["trisplat_sh"]["degree"], 2);
    assert!(scene["pbrMetallicRoughness"].get("baseColorTexture").is_none());
    assert!(backdrop.get("occlusionTexture").is_none() && backdrop.get("extras").is_none());
    assert_eq!(json["samplers"][0]["magFilter"], 9728, "texels are numbers: none between two");
    assert_eq!(json["images"][0]["mimeType"], "image/png");
    let plain = Asset { mesh: Mesh { sh: None, ..asset.mesh.clone() }, ..asset.clone() };
    let [with, without] = [&asset, &plain].map(|asset| round_trip(asset, &options).colors);
    assert_eq!(with, without);
}
