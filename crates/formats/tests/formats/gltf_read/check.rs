//! Findings of `validate` and figures of `info`.

use super::files::Builder;
use glam::Vec3;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use trisplat_formats::{
    Format,
    check::{Checked, Severity, check},
    gltf::{GltfOptions, PositionEncoding, write_glb},
    info::{SceneKind, info_of_content},
    ply,
};
use trisplat_scene::{
    Asset, FaceTexture, Provenance, Texture,
    image::RgbImage,
    mesh::{Colors, Mesh},
};
use trisplat_synthetic::soups::studio;

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a temporary folder"))
    }

    fn write(&self, name: &str, bytes: &[u8]) -> PathBuf {
        let path = self.0.path().join(name);
        std::fs::write(&path, bytes).expect("written");
        path
    }
}

fn check_bytes(name: &str, bytes: &[u8]) -> Checked {
    check(&Folder::new().write(name, bytes), &trisplat_formats::ReadOptions::default())
        .expect("readable")
}

/// "error accessor 0: has min ..." of every finding.
fn lines(checked: &Checked) -> Vec<String> {
    checked.findings.iter().map(|f| format!("{:?} {}: {}", f.severity, f.place, f.what)).collect()
}

/// A triangle as careful writers make it: with bounds.
fn valid() -> Builder {
    let mut b = Builder::triangle();
    b.json["accessors"][0]["min"] = json!([0, 0, 0]);
    b.json["accessors"][0]["max"] = json!([1, 1, 0]);
    b
}

fn asset(faces: usize) -> Asset {
    let corner =
        |i: usize| Vec3::new((i as f32 * 0.7).sin(), (i as f32 * 1.3).cos(), i as f32 * 0.01);
    let mesh = Mesh {
        positions: (0..3 * faces).map(corner).collect(),
        colors: Colors::Face((0..faces).map(|i| [i as f32 / faces as f32, 0.5, 0.0]).collect()),
        ..Mesh::default()
    };
    Asset { mesh, ..Asset::default() }
}

fn written(asset: &Asset, options: &GltfOptions) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_glb(&mut bytes, Path::new("scene.glb"), asset, options).expect("written");
    bytes
}

#[test]
fn what_we_write_is_valid() {
    for positions in [PositionEncoding::F32, PositionEncoding::ChunkU16] {
        for meshopt in [false, true] {
            let options = GltfOptions { positions, meshopt, ..GltfOptions::default() };
            let checked = check_bytes("scene.glb", &written(&asset(100), &options));
            assert_eq!(
                checked.count(Severity::Error) + checked.count(Severity::Warning),
                0,
                "{checked:?}"
            );
            assert_eq!(checked.triangles, Some(100));
            let plain = positions == PositionEncoding::F32 && !meshopt;
            assert_eq!(checked.findings.is_empty(), plain);
        }
    }
}

#[test]
fn faults_of_the_document_are_found_with_their_place() {
    let cases: Vec<(&str, Value, &str)> = vec![
        ("/bufferViews/0/byteStride", json!(13), "Error accessor 0: promises 3 elements"),
        ("/accessors/1/bufferView", json!(9), "Error bufferView 9: does not exist"),
        ("/scenes/0/nodes", json!([4]), "Error node 4: does not exist"),
        ("/buffers/0/byteLength", json!(500), "truncated"),
    ];
    for (pointer, value, wants) in cases {
        let mut b = valid();
        let (parent, key) = pointer.rsplit_once('/').expect("a pointer");
        b.json.pointer_mut(parent).expect("it is there")[key] = value;
        let found = lines(&check_bytes("a.glb", &b.glb()));
        assert!(found.iter().any(|line| line.contains(wants)), "{pointer}: {found:#?}");
    }
    assert_eq!(lines(&check_bytes("a.glb", &valid().glb())), Vec::<String>::new());
}

#[test]
fn meshes_that_engines_cull_only_as_a_whole_are_named() {
    let mut b = Builder::new();
    let position =
        b.floats("VEC3", &(0..3 * 65_536).map(|i| (i % 1000) as f32).collect::<Vec<_>>());
    let indices = b.shorts("SCALAR", 3, &[0, 1, 2]);
    b.mesh(json!({ "attributes": { "POSITION": position }, "indices": indices }));
    b.node(json!({ "mesh": 0 }));
    let found = lines(&check_bytes("a.glb", &b.glb()));
    assert!(
        found.iter().any(|l| l.starts_with("Warning mesh 0 primitive 0: has 65536 vertices")),
        "{found:#?}"
    );
}

#[test]
fn degenerate_triangles_are_counted_with_the_first_few() {
    let mut scene = asset(40);
    for face in [3, 5, 7, 11, 13] {
        scene.mesh.positions[3 * face + 1] = scene.mesh.positions[3 * face];
    }
    let line = [Vec3::ZERO, Vec3::X, Vec3::X * 2.0];
    scene.mesh.positions[60..63].copy_from_slice(&line);
    let found = lines(&check_bytes("a.glb", &written(&scene, &GltfOptions::default())));
    assert_eq!(
        found,
        [
            "Warning triangles 3, 5, 7 and 2 more: 5 have two corners in one place and cannot be seen",
            "Warning triangles 20: 1 have their corners on a line and cannot be seen",
        ]
    );
}

#[test]
fn a_broken_file_of_any_format_is_a_finding() {
    let folder = Folder::new();
    for (name, bytes) in [
        ("a.ply", &b"ply\nformat binary_little_endian 1.0\nelement vertex 9\n"[..]),
        ("a.pt", b"PK\x03\x04nothing"),
        ("a.gltf", b"{ \"asset\": "),
        ("a.off", b"COFF\n3 1 0\n0 0 0"),
        ("a.glb", b"glTF\x02\0\0\0"),
    ] {
        let path = folder.write(name, bytes);
        let checked =
            check(&path, &trisplat_formats::ReadOptions::default()).expect("a known format");
        assert_eq!(
            (checked.count(Severity::Error), checked.triangles),
            (1, None),
            "{name}: {checked:#?}"
        );
    }
    assert!(
        check(&folder.write("a.txt", b"hello"), &trisplat_formats::ReadOptions::default()).is_err(),
        "no format at all"
    );
}

/// A PLY soup of the sample generator.
fn sample(folder: &Folder) -> PathBuf {
    let mut bytes = Vec::new();
    let origin = Provenance { trainer: Some("a trainer".into()), ..Provenance::default() };
    ply::write_soup(&mut bytes, &studio(500, 1), &origin, &[]).expect("written");
    folder.write("soup.ply", &bytes)
}

#[test]
fn info_counts_what_is_there() {
    let folder = Folder::new();
    let (found, loaded) =
        info_of_content(&sample(&folder), &trisplat_formats::ReadOptions::default())
            .expect("valid");
    let triangles = loaded.stand_in().0.scene.triangle_count() as u64;
    assert_eq!(
        (found.kind, found.format, found.triangles),
        (SceneKind::Soup, Format::Ply, triangles)
    );
    for spread in [found.sigma.as_ref(), found.opacity.as_ref()] {
        let spread = spread.expect("a soup has it");
        assert!(spread.min <= spread.median && spread.median <= spread.max);
    }
    assert!(found.bounds.min.iter().zip(found.bounds.max).all(|(a, b)| *a < b));

    let path = folder.write("scene.glb", &written(&asset(50), &GltfOptions::default()));
    let (found, _) =
        info_of_content(&path, &trisplat_formats::ReadOptions::default()).expect("valid");
    assert_eq!(
        (found.kind, found.triangles, found.vertices, found.indexed),
        (SceneKind::Mesh, 50, 150, false)
    );
    let gltf = found.gltf.expect("a glTF");
    assert_eq!((gltf.meshes, gltf.primitives, gltf.materials), (1, 1, 1));
    assert_eq!(gltf.extensions_used, ["KHR_materials_unlit"]);
    assert!((found.colors.mean[1] - 0.7354).abs() < 1e-3, "sRGB of linear 0.5: {:?}", found.colors);
}

#[test]
fn a_texture_is_described_and_one_that_is_missing_is_named() {
    let folder = Folder::new();
    let mut textured = asset(4);
    let picture =
        RgbImage { size: glam::UVec2::new(48, 32), rgb: vec![[200, 90, 10]; 48 * 32], alpha: None };
    let uvs = vec![[glam::Vec2::ZERO, glam::Vec2::X, glam::Vec2::Y]; 4];
    textured.mesh.texture = Some(FaceTexture::new(uvs, std::sync::Arc::new(Texture::new(picture))));
    let bytes = written(&textured, &GltfOptions::default());
    let path = folder.write("scene.glb", &bytes);
    let options = trisplat_formats::ReadOptions::default();
    let texture = info_of_content(&path, &options).expect("readable").0.texture.expect("a texture");
    let stored = texture.stored.expect("an encoded picture");
    assert_eq!((texture.size, stored.format.as_str()), ([48, 32], "JPEG"));
    assert!((200..bytes.len() as u64).contains(&stored.bytes), "{}", stored.bytes);
    let about = |path: &Path| {
        let found = check(path, &options).expect("readable");
        lines(&found).into_iter().filter(|line| line.contains("image 0")).collect::<Vec<_>>()
    };
    assert!(about(&path).is_empty(), "{:?}", about(&path));

    // The same with its picture in a file that is not there.
    let length = u32::from_le_bytes([bytes[12], bytes[13], bytes[14], bytes[15]]) as usize;
    let mut json: Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
    json["images"][0] = json!({ "uri": "gone.jpg", "mimeType": "image/jpeg" });
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &bytes[20 + length..];
    let sizes = [20 + text.len() + rest.len(), text.len()].map(|size| (size as u32).to_le_bytes());
    let parts = [&bytes[..8], &sizes[0], &sizes[1], &bytes[16..20], &text, rest];
    let found = about(&folder.write("without.glb", &parts.concat()));
    assert!(
        found.len() == 1 && found[0].starts_with("Error") && found[0].contains("gone.jpg"),
        "{found:?}"
    );
}
