//! Files of Gaussians, made byte by byte: their conventions, and damage of every kind.

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

const PLAIN: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
];

fn owned(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| (*name).to_owned()).collect()
}

fn plain_row() -> Vec<f64> {
    vec![1.0, 2.0, 3.0, 0.5, -0.5, 1.0, 0.0, -1.0, -2.0, -3.0, 2.0, 0.0, 0.0, 2.0]
}

#[test]
fn a_ply_becomes_physical_numbers_in_any_order_of_properties() {
    let rest: Vec<String> = (0..9).map(|i| format!("f_rest_{i}")).collect();
    let names = [owned(&PLAIN), rest].concat();
    let row = [plain_row(), (0..9).map(f64::from).collect()].concat();
    let turn = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2);
    for reversed in [false, true] {
        let mut names = names.clone();
        let mut row = row.clone();
        if reversed {
            names.reverse();
            row.reverse();
        }
        let ImportedSplats { splats, warnings, .. } =
            read("a.ply", &ply(&names, "float", &[row])).expect("valid");
        assert_eq!(
            (splats.len(), splats.sh_degree, splats.positions[0]),
            (1, 1, Vec3::new(1.0, 2.0, 3.0))
        );
        assert!(close(splats.scales[0], Vec3::new(-1.0, -2.0, -3.0).exp(), 1e-6));
        assert!(same_turn(splats.rotations[0], turn, 1e-6), "{:?}", splats.rotations[0]);
        assert_eq!((splats.opacity[0], splats.filter), (0.5, ScreenFilter::DILATED));
        let wanted = [[0.5, -0.5, 1.0], [0.0, 3.0, 6.0], [1.0, 4.0, 7.0], [2.0, 5.0, 8.0]];
        assert_eq!(
            (splats.sh.as_slice(), warnings.len()),
            (wanted.as_slice(), 0),
            "red, then green, then blue"
        );
    }
    let folder = tempfile::tempdir().expect("a folder");
    let low = read_in(
        folder.path(),
        "a.ply",
        &ply(&names, "float", &[row]),
        &ReadOptions::with_degree(0),
    );
    assert_eq!(low.expect("valid").splats.sh.len(), 4, "all degrees: they are drawn");
}

#[test]
fn gaussians_of_two_scales_are_discs_that_a_filter_widens() {
    let disc: Vec<&str> = PLAIN.into_iter().filter(|name| *name != "scale_2").collect();
    let mut row = plain_row();
    row.remove(9);
    let splats = read("a.ply", &ply(&owned(&disc), "float", &[row])).expect("valid").splats;
    assert!(close(splats.scales[0], Vec3::new((-1f32).exp(), (-2f32).exp(), 0.0), 1e-6));

    let names = [owned(&PLAIN), vec!["filter_3D".to_owned()]].concat();
    let row = [plain_row(), vec![0.1]].concat();
    let splats = read("a.ply", &ply(&names, "float", &[row])).expect("valid").splats;
    let sharp = DVec3::new(-1.0, -2.0, -3.0).exp();
    let wide = (sharp * sharp + 0.01).to_array().map(f64::sqrt);
    let share = sharp.to_array().iter().zip(wide).map(|(a, b)| a / b).product::<f64>();
    assert!(close(splats.scales[0], DVec3::from(wide).as_vec3(), 1e-6));
    assert!((f64::from(splats.opacity[0]) - 0.5 * share).abs() < 1e-6);
    assert_eq!(splats.filter, ScreenFilter::MIP);
}

#[test]
fn gaussians_that_are_not_finite_are_dropped_and_counted() {
    let mut rows = vec![plain_row(); 5];
    rows[1][0] = f64::NAN;
    rows[2][7] = 1000.0; // e^1000 is beyond any float
    rows[3][10..].fill(0.0); // no rotation
    let loaded = read("a.ply", &ply(&owned(&PLAIN), "float", &rows)).expect("two are left");
    assert_eq!(loaded.splats.len(), 2);
    assert_eq!(loaded.warnings, ["dropped 3 Gaussians with non-finite values (first: Gaussian 1)"]);
    let error =
        read("a.ply", &ply(&owned(&PLAIN), "float", &rows[1..4])).expect_err("none are left");
    assert!(error.to_string().contains("none of the 3 Gaussians is finite"), "{error}");
}

#[test]
fn gaussians_far_from_the_origin_keep_their_places() {
    let mut row = plain_row();
    row[0] = 500_000.123;
    let loaded = read("a.ply", &ply(&owned(&PLAIN), "double", &[row.clone(), row])).expect("valid");
    let world = f64::from(loaded.splats.positions[0].x) + loaded.provenance.placement.center[0];
    assert!((world - 500_000.123).abs() < 1e-4, "{world}");
    assert!(loaded.warnings[0].contains("far from the origin"));
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

#[test]
fn a_compressed_ply_is_unpacked_within_the_ranges_of_its_chunk() {
    let loaded = read("a.ply", &packed(true, true)).expect("valid").splats;
    assert!(close(loaded.positions[0], Vec3::new(7.0, 5.0, 9.0), 1e-3));
    assert!(close(loaded.scales[0], Vec3::new(1.0, (-4f32).exp(), 1.0), 1e-5));
    assert!(same_turn(loaded.rotations[0], Quat::from_xyzw(0.0, 0.0, 1.0, 0.0), 1e-4));
    assert!((loaded.opacity[0] - 0.2).abs() < 1e-6, "not a logit");
    let rgb = loaded.rgb(0);
    assert!((rgb[0] - 0.5).abs() < 1e-6 && rgb[1].abs() < 1e-6, "{rgb:?}");
    assert_eq!((loaded.sh[1][0], loaded.sh[2][0], loaded.sh[1][2]), (-4.0, 4.0, 4.0));
    assert!((loaded.sh[3][0] - 4.0 / 256.0).abs() < 1e-6);
    let plain = read("a.ply", &packed(false, false)).expect("valid").splats;
    assert!((plain.rgb(0)[0] - 1.0).abs() < 1e-6 && plain.sh_degree == 0);
}

fn splat_record() -> Vec<u8> {
    let floats = [1f32, 2.0, 3.0, 0.1, 0.2, 0.3];
    let mut out: Vec<u8> = floats.iter().flat_map(|x| x.to_le_bytes()).collect();
    out.extend([255, 0, 51, 102, 128, 255, 128, 128]);
    out
}

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

#[test]
fn spz_is_unpacked_in_its_own_frame_with_y_up() {
    let half = Quat::from_xyzw(0.0, 0.0, 0.5f32.sqrt(), 0.5f32.sqrt());
    for (version, turn, bytes) in [
        (2, Quat::from_xyzw(1.0, 0.0, 0.0, 0.0), gzipped(&spz_bytes(2))),
        (3, half, gzipped(&spz_bytes(3))),
        (4, half, spz4_bytes()),
    ] {
        let loaded = read("a.spz", &bytes).expect("valid");
        let splats = loaded.splats;
        assert_eq!(splats.positions[0], Vec3::new(-1.0, 1.5, 0.0));
        assert!(close(splats.scales[0], Vec3::new(1.0, (-1f32).exp(), (-2f32).exp()), 1e-6));
        assert!((splats.opacity[0] - 0.2).abs() < 1e-6);
        assert!(
            (splats.sh[0][0] - 0.5 / 0.15).abs() < 1e-5
                && (splats.sh[0][1] + 0.5 / 0.15).abs() < 1e-5
        );
        assert_eq!(splats.sh[1], [0.0, -1.0, 0.5], "channels are innermost");
        assert!(same_turn(splats.rotations[0], turn, 1e-2), "{version}: {:?}", splats.rotations[0]);
        assert_eq!(
            (splats.filter, loaded.provenance.up),
            (ScreenFilter::ANTIALIASED, Some(UpAxis::Y))
        );
    }
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

#[test]
fn sog_is_read_from_its_pictures_and_codebooks() {
    let splats = read("a.sog", &sog_bytes(63)).expect("valid").splats;
    let wanted = Vec3::new(1f32.exp() - 1.0, 1.0 - 2f32.exp(), 0.0);
    assert!(close(splats.positions[0], wanted, 1e-5), "{:?}", splats.positions[0]);
    assert!(close(splats.scales[0], Vec3::new((-1f32).exp(), 1.0, (-1f32).exp()), 1e-6));
    assert!(
        same_turn(splats.rotations[0], Quat::from_xyzw(1.0, 0.0, 0.0, 0.0), 1e-3),
        "the largest is x"
    );
    assert_eq!(
        (splats.sh[0], splats.sh[3], splats.sh_degree),
        ([0.75, 0.0, 0.75], [-0.5, 0.0, 0.0], 1)
    );
    assert!((splats.opacity[0] - 0.2).abs() < 1e-6);
    let error = read("a.sog", &sog_bytes(64)).expect_err("a list that is not there").to_string();
    assert!(error.contains("labels.webp") && error.contains("Gaussian 0"), "{error}");
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

#[test]
fn a_gltf_of_gaussians_is_read_in_the_place_of_its_nodes() {
    let turn = Quat::from_rotation_x(std::f32::consts::FRAC_PI_2);
    let loaded = read("a.glb", &glb("", |_| {})).expect("valid");
    let splats = loaded.splats;
    assert_eq!(
        (splats.positions[0], splats.sh_degree, splats.opacity[0]),
        (Vec3::new(1.0, 2.0, 3.0), 1, 0.25)
    );
    assert_eq!(
        (splats.scales[0], splats.sh[0]),
        (Vec3::new(0.1, 0.2, 0.3), [0.5, -0.5, 1.0]),
        "linear"
    );
    assert_eq!(splats.sh[1..], [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
    assert!(same_turn(splats.rotations[0], turn, 1e-6), "x y z w");
    assert_eq!((loaded.provenance.up, loaded.warnings.len()), (Some(UpAxis::Y), 0));

    let node = r#","translation":[10,0,0],"scale":[2,2,2],"rotation":[0,0,0.70710678,0.70710678]"#;
    let loaded = read("a.glb", &glb(node, |_| {})).expect("valid");
    let splats = loaded.splats;
    assert!(close(splats.positions[0], Vec3::new(6.0, 2.0, 6.0), 1e-5), "{}", splats.positions[0]);
    assert!(close(splats.scales[0], Vec3::new(0.2, 0.4, 0.6), 1e-5));
    let wanted = Quat::from_rotation_z(std::f32::consts::FRAC_PI_2) * turn;
    assert!(same_turn(splats.rotations[0], wanted, 1e-5));
    assert!(
        splats.sh[1..].iter().all(|c| *c == [0.0; 3])
            && loaded.warnings[0].contains("from all sides")
    );
}

#[test]
fn mesh_and_gaussians_of_one_gltf_are_both_contents() {
    let beside_mesh = glb("", |document| {
        let list = |key: &str| document[key].as_array().expect("a list").len();
        let [view, accessor] = ["bufferViews", "accessors"].map(list);
        let mut add = |key: &str, value: serde_json::Value| {
            document[key].as_array_mut().expect("a list").push(value);
        };
        add("bufferViews", serde_json::json!({"buffer": 0, "byteOffset": 0, "byteLength": 36}));
        add(
            "accessors",
            serde_json::json!({"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3"}),
        );
        add("meshes", serde_json::json!({"primitives": [{"attributes": {"POSITION": accessor}}]}));
        add("nodes", serde_json::json!({"mesh": 1}));
    });
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("both.glb");
    std::fs::write(&path, beside_mesh).expect("a file");
    let contents = trisplat_formats::read_contents(&path, &ReadOptions::default()).expect("valid");
    let [Content::Scene(mesh), Content::Splats(gaussians)] = &contents[..] else {
        panic!("{contents:?}")
    };
    assert_eq!((mesh.scene.triangle_count(), gaussians.splats.len()), (1, 1));
    assert_eq!(mesh.provenance.up, gaussians.provenance.up);
    assert!(mesh.warnings.iter().any(|warning| warning.starts_with("1 Gaussian beside the mesh")));
    std::fs::write(&path, glb("", |_| {})).expect("a file");
    let alone = trisplat_formats::read_contents(&path, &ReadOptions::default()).expect("valid");
    assert!(matches!(alone[..], [Content::Splats(_)]));
}

#[test]
fn a_gltf_of_gaussians_that_cannot_be_read_says_why() {
    type Edit = fn(&mut serde_json::Value);
    let cases: [(&str, Edit, &str); 7] = [
        (r#","scale":[1,2,1]"#, |_| {}, "apply the scale"),
        (r#","scale":[-1,1,1]"#, |_| {}, "mirrors"),
        ("", |d| d["meshes"][0]["primitives"][0]["mode"] = 1.into(), "no points"),
        (
            "",
            |d| {
                d["meshes"][0]["primitives"][0]["attributes"]["KHR_gaussian_splatting:SCALE"] =
                    99.into()
            },
            "accessor 99",
        ),
        ("", |d| d["accessors"][3]["count"] = 0.into(), "expected 1 of 1"),
        (
            "",
            |d| {
                d["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["colorSpace"] =
                    "lin_rec709_display".into()
            },
            "lin_rec709_display",
        ),
        (
            "",
            |d| {
                d["meshes"][0]["primitives"][0]["extensions"]["KHR_gaussian_splatting"]["extensions"] =
                    serde_json::json!({"KHR_gaussian_splatting_compression_spz_2": {}})
            },
            "spz_2",
        ),
    ];
    for (node, edit, needle) in cases {
        let error = read("a.glb", &glb(node, edit)).expect_err(needle).to_string();
        assert!(
            error.contains("a.glb") && error.contains(needle) && !error.contains('\n'),
            "{needle}: {error}"
        );
    }
}

#[test]
fn arrays_of_spz_4_that_do_not_fit_are_refused() {
    type Edit = fn(&mut Vec<u8>);
    let cases: [(Edit, &str); 5] = [
        (|b| b[8..12].copy_from_slice(&u32::MAX.to_le_bytes()), "promises 4294967295"),
        (|b| b[40] = 10, "10 bytes by the table"),
        (|b| b[16..20].copy_from_slice(&u32::MAX.to_le_bytes()), "table of arrays"),
        (|b| b[39] = 1, "array 0: lies beyond"),
        (|b| b[128] = 0, "zstd -t"),
    ];
    for (edit, needle) in cases {
        let mut bytes = spz4_bytes();
        edit(&mut bytes);
        let error = read("a.spz", &bytes).expect_err(needle).to_string();
        assert!(error.contains(needle) && !error.contains('\n'), "{needle}: {error}");
    }
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

/// Bytes of zeros that gzip makes of a thousandth.
const BOMB: usize = 1 << 26;

#[test]
fn a_bomb_of_gzip_is_unpacked_to_what_its_header_needs() {
    let mut spz = spz_bytes(3);
    spz.resize(BOMB, 0);
    let began = std::time::Instant::now();
    assert_eq!(read("a.spz", &gzipped(&spz)).expect("the rest is left").splats.len(), 1);
    let mut many = spz_bytes(3)[..16].to_vec();
    many[8..12].copy_from_slice(&200_000_000u32.to_le_bytes());
    many.resize(BOMB, 0);
    let error = read("a.spz", &gzipped(&many)).expect_err("more than gzip can hold").to_string();
    assert!(
        error.contains("promises 200000000 Gaussians") && error.contains("cut short"),
        "{error}"
    );
    assert!(began.elapsed().as_secs() < 10, "{:?}", began.elapsed());
}

#[test]
fn a_bomb_of_zstd_is_refused_before_it_is_unpacked() {
    // A block of zstd repeats one byte 2^17 times in four bytes.
    let blocks = [[0x02, 0x00, 0x10, 0x00]; 10_000].concat();
    let frame = [&[0x28, 0xb5, 0x2f, 0xfd, 0x00, 0x58][..], &blocks, &[0x03, 0, 0x10, 0]].concat();
    for (claimed, needle) in [(1u64 << 31, "2147483648 bytes by the table"), (9, "array")] {
        let mut bytes = spz4_bytes();
        bytes[32..40].copy_from_slice(&(frame.len() as u64).to_le_bytes());
        bytes[40..48].copy_from_slice(&claimed.to_le_bytes());
        bytes.truncate(128);
        bytes.extend(&frame);
        let began = std::time::Instant::now();
        let error = read("a.spz", &bytes).expect_err("a bomb").to_string();
        assert!(error.contains(needle) && !error.contains('\n'), "{error}");
        assert!(began.elapsed().as_millis() < 1000, "{:?}", began.elapsed());
    }
}

#[test]
fn sog_bomb_is_refused_before_it_is_unpacked() {
    let large = webp_of([255, 0, 0, 255], 4000, 4000);
    let text = format!("{{\"version\": 2, \"list\": [{}0]}}", "0,".repeat(BOMB / 2)).into_bytes();
    for (name, bytes, needle) in
        [("u.webp", large, "has 16000000 pixels"), ("meta.json", text, "at most 1048576")]
    {
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        let small = zip::write::SimpleFileOptions::default();
        let mut old = zip::ZipArchive::new(std::io::Cursor::new(sog_bytes(0))).expect("an archive");
        for i in 0..old.len() {
            let entry = old.by_index(i).expect("an entry");
            if entry.name().expect("text") != name {
                archive.raw_copy_file(entry).expect("copied");
            }
        }
        archive.start_file(name, small).expect("an entry");
        archive.write_all(&bytes).expect("its bytes");
        let bytes = archive.finish().expect("a directory").into_inner();
        let began = std::time::Instant::now();
        let error = read("a.sog", &bytes).expect_err(name).to_string();
        assert!(error.contains(name) && error.contains(needle), "{error}");
        assert!(began.elapsed().as_millis() < 1000, "{:?}", began.elapsed());
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
fn splat_cameras_are_found_and_broken_ones_are_a_warning() {
    let folder = tempfile::tempdir().expect("a folder");
    let output = folder.path().join("point_cloud/iteration_30000");
    std::fs::create_dir_all(&output).expect("a folder");
    let one = r#"[{"id":0,"img_name":"a.jpg","width":64,"height":48,"position":[1,2,3],
        "rotation":[[0,0,1],[1,0,0],[0,1,0]],"fx":50,"fy":51}]"#;
    let bytes = ply(&owned(&PLAIN), "float", &[plain_row()]);
    std::fs::write(folder.path().join("cameras.json"), one).expect("writable");
    let loaded = read_in(&output, "point_cloud.ply", &bytes, &options()).expect("valid");
    let (name, camera) = &loaded.cameras[0];
    assert_eq!((name.as_str(), camera.center.to_array()), ("a.jpg", [32.0, 24.0]));
    assert!(close(camera.position(), Vec3::new(1.0, 2.0, 3.0), 1e-6));
    // The third column of the rotation is where the camera looks.
    assert!(close(camera.rotation.transpose() * Vec3::Z, Vec3::X, 1e-6));

    for broken in
        ["[{]", "[]", &one.replace("[0,0,1]", "[0,0,2]"), &one.replace("\"fx\":50", "\"fx\":-1")]
    {
        std::fs::write(folder.path().join("a.cameras.json"), broken).expect("writable");
        let loaded = read_in(folder.path(), "a.ply", &bytes, &options()).expect("valid");
        assert!(
            loaded.cameras.is_empty() && loaded.warnings[0].contains("a.cameras.json"),
            "{:?}",
            loaded.warnings
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

/// Gaussians on a slanted sheet, `size` apart; `row` makes numbers of a length and a share.
fn sheet(size: f64, row: impl Fn(f64, f64) -> [f64; 2]) -> Vec<Vec<f64>> {
    let one = |i: usize| {
        let x = (i % 16) as f64;
        let y = (i / 16) as f64;
        let [scale, opacity] = row(size * (0.3 + 0.01 * x), 0.2 + 0.003 * i as f64);
        let place = [size * x, size * y, size * (x + y)];
        [place.to_vec(), vec![0.5, -0.5, 1.0, opacity, scale, scale, scale, 1.0, 0.0, 0.0, 0.0]]
            .concat()
    };
    (0..256).map(one).collect()
}

#[test]
fn splats_without_logarithms_or_logits_are_named() {
    let logit = |share: f64| (share / (1.0 - share)).ln();
    let read =
        |rows: &[Vec<f64>]| read("a.ply", &ply(&owned(&PLAIN), "float", rows)).expect("valid");
    for size in [0.02, 1.0, 500.0] {
        let usual = read(&sheet(size, |length, share| [length.ln(), logit(share)]));
        assert_eq!(usual.warnings, [""; 0], "{size}");
        let same = |other: &ImportedSplats| {
            let pairs = usual.splats.scales.iter().zip(&other.splats.scales);
            let scales = pairs.into_iter().all(|(a, b)| close(*a / *b, Vec3::ONE, 1e-4));
            let mut opacities = usual.splats.opacity.iter().zip(&other.splats.opacity);
            scales && opacities.all(|(a, b)| (a - b).abs() < 1e-5)
        };
        let both = read(&sheet(size, |length, share| [length, share]));
        assert!(same(&both), "{size}");
        assert!(
            both.warnings[0].contains("lengths") && both.warnings[0].contains("shares"),
            "{:?}",
            both.warnings
        );
        let one = read(&sheet(size, |length, share| [length, logit(share)]));
        assert!(
            same(&one)
                && one.warnings[0].contains("lengths")
                && !one.warnings[0].contains("shares"),
            "{size}"
        );
        let other = read(&sheet(size, |length, share| [length.ln(), share]));
        assert!(
            same(&other) && other.warnings[0].starts_with("its opacities"),
            "{size}: {:?}",
            other.warnings
        );
    }
}

#[test]
fn colours_stand_in_place_of_the_first_coefficient() {
    let names: Vec<String> = PLAIN
        .iter()
        .map(|name| {
            name.replace("f_dc_0", "red").replace("f_dc_1", "green").replace("f_dc_2", "blue")
        })
        .collect();
    let row = [&[1.0, 2.0, 3.0, 0.0, 1.0, 0.2][..], &plain_row()[6..]].concat();
    let floats = ply(&names, "float", std::slice::from_ref(&row));
    let text: Vec<String> = names
        .iter()
        .map(|name| {
            format!(
                "property {} {name}\n",
                if "red green blue".contains(name.as_str()) { "uchar" } else { "float" }
            )
        })
        .collect();
    let numbers = "1 2 3 0 255 51 0 -1 -2 -3 2 0 0 2\n";
    let bytes =
        format!("ply\nformat ascii 1.0\nelement vertex 1\n{}end_header\n{numbers}", text.concat());
    for file in [floats, bytes.into_bytes()] {
        let splats = read("a.ply", &file).expect("valid").splats;
        let rgb = splats.rgb(0);
        assert!(close(Vec3::from(rgb), Vec3::new(0.0, 1.0, 0.2), 1e-6), "{rgb:?}");
    }
}

#[test]
fn a_gltf_may_hold_its_gaussians_as_spz() {
    let folder = tempfile::tempdir().expect("a folder");
    let spz = gzipped(&spz_bytes(2));
    std::fs::write(folder.path().join("splats.bin"), &spz).expect("writable");
    let packed = |d: &mut serde_json::Value| {
        let view = d["bufferViews"].as_array().expect("a list").len();
        let length = spz.len();
        let list = |d: &mut serde_json::Value, key: &str, value| {
            d[key].as_array_mut().expect("a list").push(value)
        };
        list(d, "buffers", serde_json::json!({"byteLength": length, "uri": "splats.bin"}));
        list(d, "bufferViews", serde_json::json!({"buffer": 1, "byteLength": length}));
        list(d, "extensionsRequired", "KHR_gaussian_splatting_compression_spz_2".into());
        let primitive = &mut d["meshes"][0]["primitives"][0];
        primitive["attributes"] = serde_json::json!({"POSITION": 0});
        primitive["extensions"]["KHR_gaussian_splatting"]["extensions"] =
            serde_json::json!({"KHR_gaussian_splatting_compression_spz_2": {"bufferView": view}});
    };
    let read = |node: &str| {
        read_in(folder.path(), "a.glb", &glb(node, packed), &options()).expect("valid").splats
    };
    let alone = read_in(folder.path(), "a.spz", &spz, &options()).expect("valid").splats;
    let moved = read("");
    assert_eq!(moved, alone);
    let moved = read(r#","translation":[10,0,0],"scale":[2,2,2]"#);
    assert!(close(moved.positions[0], 2.0 * alone.positions[0] + 10.0 * Vec3::X, 1e-6));
    assert!(close(moved.scales[0], 2.0 * alone.scales[0], 1e-6));
    assert_eq!((&moved.sh, moved.filter), (&alone.sh, ScreenFilter::ANTIALIASED));
}

#[test]
fn an_unzipped_sog_is_read_by_its_folder_or_its_list() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = folder.path().join("toy");
    let mut zip = zip::ZipArchive::new(std::io::Cursor::new(sog_bytes(63))).expect("a zip");
    zip.extract(&at).expect("writable");
    let zipped = read_in(folder.path(), "a.sog", &sog_bytes(63), &options()).expect("valid").splats;
    for path in [at.clone(), at.join("meta.json")] {
        match read_content(&path, &options()).expect("valid") {
            Content::Splats(loaded) => assert_eq!(loaded.splats, zipped),
            Content::Scene(_) => panic!("Gaussians"),
        }
    }
    std::fs::remove_file(at.join("means_l.webp")).expect("there");
    assert!(
        read_content(&at, &options()).expect_err("a folder").to_string().contains("is a folder")
    );
}

/// Gaussians on an ellipsoid beside the origin, and a list of cameras around it; `file` moves the
/// Gaussians.
fn seen_from_around(folder: &Path, file: impl Fn(DVec3) -> DVec3) -> ImportedSplats {
    let middle = DVec3::new(4.0, 3.0, -2.0);
    let row = |i: usize| {
        let turn = 2.4 * i as f64;
        let z = 1.0 - 2.0 * (i as f64 + 0.5) / 900.0;
        let round = (1.0 - z * z).sqrt();
        let place =
            file(middle + DVec3::new(2.0 * round * turn.cos(), round * turn.sin(), 0.6 * z));
        [&place.to_array()[..], &[0.5, -0.5, 1.0, 3.0, -3.0, -3.0, -3.0, 1.0, 0.0, 0.0, 0.0]]
            .concat()
    };
    let rows: Vec<Vec<f64>> = (0..900).map(row).collect();
    let camera = |i: usize| {
        let turn = 0.3 * i as f64;
        let eye = middle + DVec3::new(3.0 * turn.cos(), 2.0 * turn.sin(), 2.0);
        let forward = (middle - eye).normalize();
        let right = forward.cross(DVec3::Z).normalize();
        let down = forward.cross(right);
        let rows = [0, 1, 2].map(|axis| [right[axis], down[axis], forward[axis]]);
        serde_json::json!({"img_name": format!("{i}.jpg"), "width": 64, "height": 48, "position": eye.to_array(),
            "rotation": rows, "fx": 40.0, "fy": 40.0})
    };
    let cameras: Vec<_> = (0..21).map(camera).collect();
    std::fs::write(folder.join("cameras.json"), serde_json::Value::from(cameras).to_string())
        .expect("writable");
    read_in(folder, "a.ply", &ply(&owned(&PLAIN), "float", &rows), &options()).expect("valid")
}

#[test]
fn cameras_of_another_frame_are_turned_of_another_scene_unused() {
    let folder = tempfile::tempdir().expect("a folder");
    let own = seen_from_around(folder.path(), |place| place);
    assert_eq!((own.cameras.len(), &own.warnings), (21, &Vec::new()));
    let other = seen_from_around(folder.path(), |place| DVec3::new(place.x, -place.y, -place.z));
    assert!(other.warnings[0].contains("(x, -y, -z)"), "{:?}", other.warnings);
    for ((_, camera), (_, turned)) in own.cameras.iter().zip(&other.cameras) {
        for (point, other) in own.splats.positions.iter().zip(&other.splats.positions) {
            let [a, b] = [camera.project(*point), turned.project(*other)];
            assert!(
                a.zip(b).is_none_or(|((a, _), (b, _))| a.distance(b) < 1e-3),
                "the same picture"
            );
        }
    }
    let other = seen_from_around(folder.path(), |place| place + 100.0 * DVec3::Z);
    assert!(
        other.cameras.is_empty() && other.warnings[0].contains("not used"),
        "{:?}",
        other.warnings
    );
}
