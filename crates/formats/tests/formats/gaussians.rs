//! Files of 3D Gaussian splatting, in every format there is: each is one error that says what it is
//! and what to do.

use std::io::Write;
use std::path::Path;
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_scene::Error;

const PLY: &[u8] = b"ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\n\
    property float f_dc_0\nproperty float opacity\nproperty float scale_0\nproperty float rot_0\nend_header\n0123456789012345678901234567";
const COMPRESSED_PLY: &[u8] =
    b"ply\nformat binary_little_endian 1.0\nelement chunk 1\nproperty float min_x\nelement vertex 1\n\
    property uint packed_position\nproperty uint packed_rotation\nend_header\n01230123";
const META_JSON: &[u8] =
    br#"{"version":2,"count":1,"means":{"files":["means_l.webp"]},"scales":{},"quats":{},"sh0":{}}"#;

/// A glTF of one point with the extension, asked for in `list`.
fn gltf(list: &str) -> Vec<u8> {
    let position = r#"{"bufferView":0,"componentType":5126,"count":1,"type":"VEC3","min":[0,0,0],"max":[0,0,0]}"#;
    let points = r#"{"attributes":{"POSITION":0},"mode":0,"extensions":{"KHR_gaussian_splatting":{"kernel":"ellipse"}}}"#;
    format!(
        r#"{{"asset":{{"version":"2.0"}},{list},"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
        "buffers":[{{"byteLength":12,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAA"}}],
        "bufferViews":[{{"buffer":0,"byteLength":12}}],"accessors":[{position}],"meshes":[{{"primitives":[{points}]}}]}}"#
    )
    .into_bytes()
}

fn sog() -> Vec<u8> {
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, content) in [("meta.json", META_JSON), ("means_l.webp", b"RIFF")] {
        let stored = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored);
        archive.start_file(name, stored).expect("an entry");
        archive.write_all(content).expect("its bytes");
    }
    archive.finish().expect("a directory").into_inner()
}

fn refusal(folder: &Path, name: &str, content: &[u8]) -> String {
    let path = folder.join(name);
    std::fs::write(&path, content).expect("writable");
    match formats::read(&path, &ReadOptions::with_degree(0)) {
        Err(error @ Error::Unsupported { .. }) => error.to_string(),
        other => panic!("{name}: {other:?}"),
    }
}

#[test]
fn every_format_of_gaussians_is_named_and_has_a_remedy() {
    let folder = tempfile::tempdir().expect("a folder");
    let cases: [(&str, &str, Vec<u8>); 11] = [
        ("a.ply", "PLY", PLY.into()),
        ("b.ply", "PLY", COMPRESSED_PLY.into()),
        ("a.splat", ".splat", vec![0x3f; 64]),
        ("a.ksplat", ".ksplat", vec![0; 4096]),
        ("a.spz", "SPZ", b"\x1f\x8b\x08\0\0\0\0\0".to_vec()),
        ("renamed", "SPZ", b"NGSP\x04\0\0\0".to_vec()),
        ("a.sog", "SOG", sog()),
        ("a.zip", "SOG", sog()),
        ("meta.json", "SOG", META_JSON.into()),
        ("a.gltf", "glTF", gltf(r#""extensionsUsed":["KHR_gaussian_splatting"]"#)),
        (
            "b.gltf",
            "glTF",
            gltf(r#""extensionsRequired":["KHR_gaussian_splatting_compression_spz_2"]"#),
        ),
    ];
    for (name, kind, content) in cases {
        let message = refusal(folder.path(), name, &content);
        let is_read = !["a.ksplat", "meta.json"].contains(&name);
        let (what, remedy) = if is_read {
            (format!("({kind})"), "trisplat bake")
        } else {
            (format!("as {kind}"), "which is not read; save them as PLY")
        };
        assert!(
            message.contains(&format!("{name}: holds 3D Gaussians {what}")),
            "{name}: {message}"
        );
        assert!(message.contains(remedy) && !message.contains('\n'), "{message}");
    }
}

#[test]
fn points_that_are_no_gaussians_are_not_called_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let message =
        refusal(folder.path(), "a.gltf", &gltf(r#""extensionsUsed":["KHR_materials_unlit"]"#));
    assert!(
        message.contains("points and lines are not read") && !message.contains("Gaussians"),
        "{message}"
    );
}

#[test]
fn a_list_of_files_of_gaussians_is_no_broken_list_of_photos() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("meta.json");
    std::fs::write(&path, META_JSON).expect("writable");
    let error =
        trisplat_dataset::Dataset::load(&path, &trisplat_dataset::DatasetOptions::default())
            .expect_err("no photos");
    assert_eq!(error.to_string(), refusal(folder.path(), "meta.json", META_JSON));
}
