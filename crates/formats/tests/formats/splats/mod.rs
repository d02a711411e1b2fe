//! Files of Gaussians, made byte by byte: their conventions, and damage of every kind.

mod cameras;
mod gltf;
mod ply;
mod sog;
mod spz;

use glam::{DVec3, Quat, Vec3};
use std::io::Write;
use std::path::Path;
use trisplat_formats::{Content, ReadOptions, read_content};
use trisplat_scene::{Error, ImportedSplats, Limits, Result, ScreenFilter, UpAxis};

fn options() -> ReadOptions {
    ReadOptions::with_degree(3)
}

fn read_in(
    folder: &Path,
    name: &str,
    bytes: &[u8],
    options: &ReadOptions,
) -> Result<ImportedSplats> {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("writable");
    match read_content(&path, options)? {
        Content::Splats(splats) => Ok(splats),
        Content::Scene(_) => panic!("{name} holds Gaussians"),
    }
}

fn read(name: &str, bytes: &[u8]) -> Result<ImportedSplats> {
    read_in(tempfile::tempdir().expect("a folder").path(), name, bytes, &options())
}

fn close(a: Vec3, b: Vec3, tolerance: f32) -> bool {
    a.abs_diff_eq(b, tolerance)
}

/// The same turn, whichever sign the quaternion has.
fn same_turn(a: Quat, b: Quat, tolerance: f32) -> bool {
    a.dot(b).abs() > 1.0 - tolerance
}

const PLAIN: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
];

fn plain_row() -> Vec<f64> {
    vec![1.0, 2.0, 3.0, 0.5, -0.5, 1.0, 0.0, -1.0, -2.0, -3.0, 2.0, 0.0, 0.0, 2.0]
}

fn owned(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn ply(names: &[String], kind: &str, rows: &[Vec<f64>]) -> Vec<u8> {
    let mut out = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n", rows.len());
    names.iter().for_each(|name| out += &format!("property {kind} {name}\n"));
    let mut out = (out + "end_header\n").into_bytes();
    for number in rows.iter().flatten() {
        match kind {
            "double" => out.extend(number.to_le_bytes()),
            _ => out.extend((*number as f32).to_le_bytes()),
        }
    }
    out
}

/// One chunk of one Gaussian, with and without colours of the chunk.
fn packed(colors: bool, sh: bool) -> Vec<u8> {
    let mut names = Vec::new();
    for side in ["min", "max"] {
        names.extend(["x", "y", "z"].map(|axis| format!("{side}_{axis}")));
    }
    for side in ["min", "max"] {
        names.extend(["x", "y", "z"].map(|axis| format!("{side}_scale_{axis}")));
    }
    let mut numbers = vec![0f32, 0.0, 0.0, 2047.0, 1023.0, 2047.0, -4.0, -4.0, -4.0, 0.0, 0.0, 0.0];
    if colors {
        for side in ["min", "max"] {
            names.extend(["r", "g", "b"].map(|channel| format!("{side}_{channel}")));
        }
        numbers.extend([0.0, 0.0, 0.0, 0.5, 0.5, 0.5]);
    }
    let mut out = "ply\nformat binary_little_endian 1.0\nelement chunk 1\n".to_owned();
    names.iter().for_each(|name| out += &format!("property float {name}\n"));
    out += "element vertex 1\n";
    for name in ["position", "rotation", "scale", "color"] {
        out += &format!("property uint packed_{name}\n");
    }
    if sh {
        out += "element sh 1\n";
        (0..9).for_each(|i| out += &format!("property uchar f_rest_{i}\n"));
    }
    let mut out = (out + "end_header\n").into_bytes();
    numbers.iter().for_each(|number| out.extend(number.to_le_bytes()));
    let words: [u32; 4] = [
        7 << 21 | 5 << 11 | 9,
        3 << 30 | 512 << 20 | 512 << 10 | 512,
        2047 << 21 | 2047,
        0xff_00_ff_33,
    ];
    words.iter().for_each(|word| out.extend(word.to_le_bytes()));
    if sh {
        out.extend([0, 255, 128, 0, 0, 0, 255, 255, 255]);
    }
    out
}

fn splat_record() -> Vec<u8> {
    let floats = [1f32, 2.0, 3.0, 0.1, 0.2, 0.3];
    let mut out: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    out.extend([255, 0, 51, 102, 128, 255, 128, 128]);
    out
}

/// A version-2 or version-3 file of one Gaussian with SH degree 1.
fn spz_bytes(version: u32) -> Vec<u8> {
    let mut out = b"NGSP".to_vec();
    out.extend(version.to_le_bytes());
    out.extend(1u32.to_le_bytes());
    out.extend([1, 8, 1, 0]);
    out.extend([0x00, 0xff, 0xff, 0x80, 0x01, 0x00, 0x00, 0x00, 0x00]);
    out.push(51);
    out.extend([255, 0, 128]);
    out.extend([160, 144, 128]);
    match version {
        2 => out.extend([255, 128, 128]),
        _ => out.extend((2u32 << 30 | 511).to_le_bytes()),
    }
    out.extend([128, 0, 192, 128, 128, 128, 128, 128, 128]);
    out
}

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    let mut packed = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    packed.write_all(bytes).expect("in memory");
    packed.finish().expect("in memory")
}

/// The same in version 4: an array of each quantity, in frames of zstd that store the bytes as they
/// are.
fn spz4_bytes() -> Vec<u8> {
    let mut out = spz_bytes(3);
    let mut rest = out.split_off(16);
    out[4] = 4;
    out[15] = 6;
    out.extend(32u32.to_le_bytes());
    out.extend([0; 12]);
    let mut frames = Vec::new();
    for length in [9u8, 1, 3, 3, 4, 9] {
        let behind = rest.split_off(usize::from(length));
        let frame =
            [&[0x28, 0xb5, 0x2f, 0xfd, 0x20, length, length << 3 | 1, 0, 0], &rest[..]].concat();
        out.extend((frame.len() as u64).to_le_bytes());
        out.extend(u64::from(length).to_le_bytes());
        frames.extend(frame);
        rest = behind;
    }
    [out, frames].concat()
}

fn webp(pixels: [u8; 4], width: u32) -> Vec<u8> {
    webp_of(pixels, width, 1)
}

fn webp_of(pixels: [u8; 4], width: u32, height: u32) -> Vec<u8> {
    let mut out = Vec::new();
    let bytes = pixels.repeat((width * height) as usize);
    image::codecs::webp::WebPEncoder::new_lossless(&mut out)
        .encode(&bytes, width, height, image::ExtendedColorType::Rgba8)
        .expect("in memory");
    out
}

fn sog_bytes(label: u8) -> Vec<u8> {
    let codes = |at: usize, value: f64| {
        let mut codes = vec![0.0; 256];
        codes[at] = value;
        serde_json::json!(codes)
    };
    let meta = serde_json::json!({
        "version": 2, "count": 1,
        "means": {"mins": [0.0, -2.0, 0.0], "maxs": [1.0, 0.0, 1.0], "files": ["l.webp", "u.webp"]},
        "scales": {"codebook": codes(7, -1.0), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": codes(9, 0.75), "files": ["sh0.webp"]},
        "shN": {"count": 64, "bands": 1, "codebook": codes(3, -0.5), "files": ["lists.webp", "labels.webp"]},
    });
    let files = [
        ("meta.json", meta.to_string().into_bytes()),
        ("l.webp", webp([255, 0, 0, 255], 2)),
        ("u.webp", webp([255, 0, 0, 255], 2)),
        ("scales.webp", webp([7, 0, 7, 255], 2)),
        ("quats.webp", webp([128, 128, 128, 253], 2)),
        ("sh0.webp", webp([9, 0, 9, 51], 2)),
        ("lists.webp", webp([3, 0, 0, 255], 64 * 3)),
        ("labels.webp", webp([label, 0, 0, 255], 2)),
        ("means_l.webp", Vec::new()),
    ];
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, content) in files {
        let stored = zip::write::SimpleFileOptions::default()
            .compression_method(zip::CompressionMethod::Stored);
        archive.start_file(name, stored).expect("an entry");
        archive.write_all(&content).expect("its bytes");
    }
    archive.finish().expect("a directory").into_inner()
}

/// A GLB of one Gaussian with SH of degree 1 under a node with these properties; `edit` changes the
/// document.
fn glb(node: &str, edit: impl Fn(&mut serde_json::Value)) -> Vec<u8> {
    let half = 0.5f32.sqrt();
    let numbers = [
        vec![1.0, 2.0, 3.0],
        vec![half, 0.0, 0.0, half],
        vec![0.1, 0.2, 0.3],
        vec![0.25],
        vec![0.5, -0.5, 1.0],
        vec![1.0, 2.0, 3.0],
        vec![4.0, 5.0, 6.0],
        vec![7.0, 8.0, 9.0],
    ];
    let names = [
        "ROTATION",
        "SCALE",
        "OPACITY",
        "SH_DEGREE_0_COEF_0",
        "SH_DEGREE_1_COEF_0",
        "SH_DEGREE_1_COEF_1",
        "SH_DEGREE_1_COEF_2",
    ];
    let mut attributes = serde_json::json!({"POSITION": 0});
    names.iter().enumerate().for_each(|(i, name)| {
        attributes[format!("KHR_gaussian_splatting:{name}")] = (i + 1).into();
    });
    let mut views = Vec::new();
    let mut accessors = Vec::new();
    let mut bin = Vec::<u8>::new();
    for (i, values) in numbers.iter().enumerate() {
        let shape = ["", "SCALAR", "", "VEC3", "VEC4"][values.len()];
        views.push(serde_json::json!({"buffer": 0, "byteOffset": bin.len(), "byteLength": 4 * values.len()}));
        accessors.push(
            serde_json::json!({"bufferView": i, "componentType": 5126, "count": 1, "type": shape}),
        );
        values.iter().for_each(|value| bin.extend(value.to_le_bytes()));
    }
    let splatting = serde_json::json!({"kernel": "ellipse", "colorSpace": "srgb_rec709_display"});
    let primitive = serde_json::json!({"mode": 0, "attributes": attributes, "extensions": {"KHR_gaussian_splatting": splatting}});
    let node: serde_json::Value =
        serde_json::from_str(&format!("{{\"mesh\": 0{node}}}")).expect("JSON");
    let mut document = serde_json::json!({
        "asset": {"version": "2.0"}, "extensionsUsed": ["KHR_gaussian_splatting"], "extensionsRequired": ["KHR_gaussian_splatting"],
        "nodes": [node], "meshes": [{"primitives": [primitive]}], "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": bin.len()}],
    });
    edit(&mut document);
    let mut json = document.to_string().into_bytes();
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |length: usize| (length as u32).to_le_bytes().to_vec();
    let all = 28 + json.len() + bin.len();
    let json_length = word(json.len());
    let bin_length = word(bin.len());
    [
        b"glTF".to_vec(),
        word(2),
        word(all),
        json_length,
        b"JSON".to_vec(),
        json,
        bin_length,
        b"BIN\0".to_vec(),
        bin,
    ]
    .concat()
}

/// Bytes of zeros that gzip makes of a thousandth.
const BOMB: usize = 1 << 26;

#[test]
fn a_splat_file_has_linear_scales_and_bytes_for_the_rest() {
    let loaded = read("a.splat", &splat_record().repeat(2)).expect("valid").splats;
    let packed = gzipped(&splat_record().repeat(2));
    assert_eq!(read("a.splat.gz", &packed).expect("its name tells it").splats, loaded);
    assert_eq!((loaded.len(), loaded.positions[1]), (2, Vec3::new(1.0, 2.0, 3.0)));
    assert!(close(loaded.scales[0], Vec3::new(0.1, 0.2, 0.3), 1e-7));
    let rgb = loaded.rgb(0);
    assert!(
        (rgb[0] - 1.0).abs() < 1e-6 && rgb[1].abs() < 1e-6 && (rgb[2] - 0.2).abs() < 1e-6,
        "{rgb:?}"
    );
    assert!((loaded.opacity[0] - 0.4).abs() < 1e-6);
    assert!(
        same_turn(loaded.rotations[0], Quat::from_xyzw(1.0, 0.0, 0.0, 0.0), 1e-5),
        "w comes first"
    );
}

#[test]
fn a_file_cut_anywhere_is_one_error_or_another_format() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = [
        ("a.ply", ply(&owned(&PLAIN), "float", &[plain_row(), plain_row()])),
        ("b.ply", packed(true, true)),
        ("a.splat", splat_record().repeat(2)),
        ("a.spz", gzipped(&spz_bytes(2))),
        ("b.spz", gzipped(&spz_bytes(3)[..40])),
        ("c.spz", spz4_bytes()),
        ("a.glb", glb("", |_| {})),
        ("a.sog", sog_bytes(0)),
    ];
    for (name, bytes) in files {
        for cut in (0..bytes.len()).step_by(bytes.len().div_ceil(60)) {
            if name == "a.splat" && cut == 32 {
                continue;
            }
            let path = folder.path().join(name);
            std::fs::write(&path, &bytes[..cut]).expect("writable");
            let error = read_content(&path, &options()).expect_err("cut short").to_string();
            assert!(error.contains(name) && !error.contains('\n'), "{name} at {cut}: {error}");
        }
    }
}

#[test]
fn versions_without_a_reader_are_refused_with_a_remedy() {
    let v1 = gzipped(&spz_bytes(1));
    let cases: [(&str, &[u8], &str); 3] = [
        ("a.spz", b"NGSP\x05\0\0\0and the rest of it", "SPZ version 5"),
        ("b.spz", &v1, "SPZ version 1"),
        ("a.ksplat", &[0; 4096], ".ksplat"),
    ];
    for (name, bytes, kind) in cases {
        let error = read(name, bytes).expect_err("no reader");
        assert!(
            matches!(error, Error::Unsupported { .. }) && error.to_string().contains(kind),
            "{error}"
        );
    }
}

#[test]
fn triangles_are_read_whole_after_the_look_for_gaussians() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("a.ply");
    let text = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
                property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    std::fs::write(&path, text).expect("writable");
    match read_content(&path, &options()).expect("a mesh") {
        Content::Scene(loaded) => assert_eq!(loaded.scene.triangle_count(), 1),
        Content::Splats(_) => panic!("triangles"),
    }
}

#[test]
fn glb_promises_beyond_the_file_are_refused_before_memory() {
    let mut many = spz_bytes(3);
    many[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
    let error = read("a.spz", &gzipped(&many)).expect_err("not there").to_string();
    assert!(error.contains("promises 4294967295 Gaussians"), "{error}");
    let folder = tempfile::tempdir().expect("a folder");
    let few = ReadOptions { limits: Limits { vertices: 1, ..Limits::DEFAULT }, ..options() };
    let two = ply(&owned(&PLAIN), "float", &[plain_row(), plain_row()]);
    for (name, bytes) in [("a.ply", two), ("a.splat", splat_record().repeat(2))] {
        let error = read_in(folder.path(), name, &bytes, &few).expect_err("too many");
        assert!(matches!(error, Error::Limit { .. }), "{error}");
    }
}
