//! Files that are no plain scene: pointers of git-lfs, lists, states of trainings, Gaussians of
//! other kinds; and the up axis of programs.

use super::files::source;
use std::path::Path;
use trisplat_fixtures::checkpoints::{entry, zip};
use trisplat_formats::{self as formats, Content, ReadOptions};
use trisplat_scene::UpAxis;

fn in_folder(files: &[(&str, &[u8])]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).expect("written");
    }
    folder
}

fn content(path: &Path) -> trisplat_scene::Result<Content> {
    formats::read_content(path, &ReadOptions::default())
}

fn refusal(name: &str, bytes: &[u8]) -> String {
    let folder = in_folder(&[(name, bytes)]);
    content(&folder.path().join(name)).expect_err(name).to_string()
}

#[test]
fn git_lfs_pointer_of_any_format_names_git_lfs_pull() {
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 251773\n";
    for name in ["a.ply", "a.glb", "a.gltf", "a.obj", "a.off", "a.splat", "a.spz", "a.sog", "a.pt"]
    {
        let text = refusal(name, pointer);
        assert!(text.contains("git lfs pull") && text.contains(name), "{name}: {text}");
    }
    // A buffer beside a good glTF.
    let gltf = br#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],
        "bufferViews":[{"buffer":0,"byteLength":36}],"buffers":[{"byteLength":36,"uri":"a.bin"}]}"#;
    let folder = in_folder(&[("a.gltf", gltf), ("a.bin", pointer)]);
    let text = content(&folder.path().join("a.gltf")).expect_err("a pointer").to_string();
    assert!(text.contains("a.bin") && text.contains("git lfs pull"), "{text}");
    // A library beside a good OBJ.
    let obj = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl m\nf 1 2 3\n";
    let folder = in_folder(&[("a.obj", obj), ("a.mtl", pointer)]);
    let loaded = formats::read(&folder.path().join("a.obj"), &ReadOptions::default());
    assert!(loaded.expect("valid").warnings[0].contains("git lfs pull"));
}

#[test]
fn streamed_sog_names_its_finest_files() {
    let list = br#"{"version":1,"lodLevels":2,"filenames":["0_0/meta.json","1_0/meta.json","0_1/meta.json"],"tree":{}}"#;
    let text = refusal("lod-meta.json", list);
    assert!(text.ends_with("finest level: 0_0/meta.json, 0_1/meta.json"), "{text}");
    let folder = in_folder(&[("lod-meta.json", list)]);
    let of_folder = content(folder.path()).expect_err("a folder").to_string();
    assert!(of_folder.contains("streamed SOG"), "{of_folder}");
    let as_data = trisplat_dataset::Dataset::load(
        folder.path().join("lod-meta.json"),
        &trisplat_dataset::DatasetOptions::default(),
    );
    assert!(as_data.expect_err("no photos").to_string().contains("streamed SOG"));
}

#[test]
fn state_of_a_training_names_the_file_to_give() {
    // A tuple of tensors and a number, as `torch.save((model.capture(), 30000), ...)` writes it.
    let tensor = |shape: &[u8]| {
        let mut text = b"ctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpuK$tQK\0".to_vec();
        text.extend(shape);
        text.extend(b"\x89ccollections\nOrderedDict\n)RtR");
        text
    };
    let state = |shape: &[u8]| {
        let pickle = [b"\x80\x02", &tensor(shape)[..], b"M0u\x86."].concat();
        zip(&[
            entry("data.pkl", &pickle),
            entry("byteorder", b"little"),
            entry("data/0", &[0; 144]),
        ])
    };
    let triangles = refusal("chkpnt30000.pth", &state(b"K\x04K\x03K\x03\x87K\x09K\x03K\x01\x87"));
    assert!(
        triangles.contains("state of a training; give point_cloud_state_dict.pt"),
        "{triangles}"
    );
    let gaussians = refusal("chkpnt7000.pth", &state(b"K\x09K\x04\x86K\x04K\x01\x86"));
    assert!(
        gaussians.contains("holds 3D Gaussians") && gaussians.contains("point_cloud.ply"),
        "{gaussians}"
    );
}

/// A PLY of Gaussians with these columns more, all zeros but the rotation.
fn splats(more: &[&str]) -> Vec<u8> {
    let base = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "rot_0", "rot_1",
        "rot_2", "rot_3",
    ];
    let names: Vec<&str> = base.iter().chain(more).copied().collect();
    let head: String = names.iter().map(|name| format!("property float {name}\n")).collect();
    let row: Vec<&str> =
        names.iter().map(|name| if *name == "rot_0" { "1" } else { "0" }).collect();
    format!("ply\nformat ascii 1.0\nelement vertex 1\n{head}end_header\n{}\n", row.join(" ")).into()
}

#[test]
fn splats_of_other_kinds_are_refused_or_warned_of() {
    let warned = |files: &[(&str, &[u8])]| {
        let folder = in_folder(files);
        match content(&folder.path().join("a.ply")) {
            Ok(Content::Splats(splats)) => (splats.warnings.join("; "), splats.splats),
            other => panic!("{other:?}"),
        }
    };
    // One scale: balls.
    let (text, ball) = warned(&[("a.ply", &splats(&[]))]);
    assert_eq!((text.as_str(), ball.scales[0]), ("", glam::Vec3::ONE));
    let plain = splats(&["scale_1", "scale_2"]);
    assert_eq!(warned(&[("a.ply", &plain)]).0, "");
    let (text, _) = warned(&[("a.ply", &splats(&["scale_1", "scale_2", "t", "scale_t"]))]);
    assert!(text.contains("in time (t, scale_t): all moments are drawn at once"), "{text}");
    let (text, _) = warned(&[("a.ply", &plain), ("deformation.pth", b"PK")]);
    assert!(text.contains("deformation.pth beside it"), "{text}");
    let (text, _) = warned(&[("a.ply", &splats(&["scale_1", "scale_2", "beta"]))]);
    assert!(text.contains("not read, which may change their look: beta"), "{text}");
    let anchors = String::from_utf8(splats(&["f_offset_0"])).expect("text");
    let text = refusal("a.ply", anchors.replace("f_dc_", "f_anchor_feat_").as_bytes());
    assert!(text.contains("anchors of Scaffold-GS") && text.contains("export plain"), "{text}");
    for (name, kind) in [("a.splatv", ".splatv"), ("a.spx", ".spx"), ("a.rad", ".rad")] {
        assert!(refusal(name, &[7; 64]).contains(&format!("3D Gaussians as {kind}")));
    }
}

#[test]
fn drafts_of_gaussian_splatting_are_named() {
    let glb = |attributes: &str, extension: &str, used: &str| {
        format!(
            r#"{{"asset":{{"version":"2.0"}},"extensionsUsed":["{used}"],"scene":0,"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0}}],
            "buffers":[{{"byteLength":12,"uri":"data:application/octet-stream;base64,AAAAAAAAAAAAAAAA"}}],
            "bufferViews":[{{"buffer":0,"byteLength":12}}],"accessors":[{{"bufferView":0,"componentType":5126,"count":1,"type":"VEC3"}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0{attributes}}},"mode":0,"extensions":{{{extension}}}}}]}}]}}"#
        )
    };
    let old = r#","_ROTATION":0,"_SCALE":0,"COLOR_0":0"#;
    let main = "KHR_gaussian_splatting";
    let spz = "KHR_gaussian_splatting_compression_spz";
    for (document, sign) in [
        (glb(old, r#""KHR_gaussian_splatting":{}"#, main), "_ROTATION and _SCALE"),
        (
            glb(
                old,
                r#""KHR_spz_gaussian_splats_compression":{"bufferView":0}"#,
                "KHR_spz_gaussian_splats_compression",
            ),
            "KHR_spz_gaussian",
        ),
        (
            glb(
                "",
                r#""KHR_gaussian_splatting":{"extensions":{"KHR_gaussian_splatting_compression_spz":{"bufferView":0}}}"#,
                spz,
            ),
            spz,
        ),
    ] {
        let text = refusal("a.gltf", document.as_bytes());
        assert!(
            text.contains("a draft of KHR_gaussian_splatting") && text.contains(sign),
            "{text}"
        );
        let required = document.replace("extensionsUsed", "extensionsRequired");
        assert!(refusal("a.gltf", required.as_bytes()).contains("a draft of"), "{sign}");
    }
}

#[test]
fn meshes_are_y_up_unless_their_program_says_otherwise() {
    let options = ReadOptions::default();
    let faces = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nf 1 2 3\nf 2 4 3\n";
    let obj = |head: &str| {
        let text = format!("{head}{faces}");
        formats::obj::read(source(text.as_bytes()), &options).expect("valid").provenance
    };
    for (head, said) in [
        ("", None),
        ("# made by hand\n", None),
        ("# Blender 4.2.0\n# www.blender.org\n", Some(UpAxis::Y)),
        ("# 3ds Max Wavefront OBJ Exporter v0.97b\n", Some(UpAxis::Y)),
        ("# Z-up\n", Some(UpAxis::Z)),
        ("# up axis: z\n# Blender 4.2.0\n", Some(UpAxis::Z)),
    ] {
        let provenance = obj(head);
        assert_eq!(
            (provenance.up, provenance.up_axis()),
            (said, said.unwrap_or(UpAxis::Y)),
            "{head}"
        );
    }
    let ply = |comment: &str| {
        let head = "property float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\n";
        let text = format!(
            "ply\nformat ascii 1.0\n{comment}element vertex 3\n{head}end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 2 1\n"
        );
        let folder =
            in_folder(&[("a.ply", text.as_bytes()), ("meshed-poisson.ply", text.as_bytes())]);
        let read = |name: &str| {
            formats::read(&folder.path().join(name), &options).expect("valid").provenance.up_axis()
        };
        (read("a.ply"), read("meshed-poisson.ply"))
    };
    assert_eq!(ply(""), (UpAxis::Y, UpAxis::NegY), "COLMAP's meshes by their names");
    assert_eq!(ply("comment Created by Open3D\n").0, UpAxis::NegY);
    assert_eq!(ply("comment Created by Blender 4.2.0 - www.blender.org\n").0, UpAxis::Z);
    let off = |text: &str| {
        formats::off::read(source(text.as_bytes()), &options).expect("valid").provenance.up_axis()
    };
    assert_eq!(off("OFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n3 0 1 2\n3 1 3 2\n"), UpAxis::Y);
    let of_soup = "COFF\n6 2 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 1\n0 1 1\n3 0 1 2\n3 3 4 5\n";
    assert_eq!(off(of_soup), UpAxis::NegY, "a soup of the authors' script");
}

#[test]
fn numbers_that_are_none_and_old_line_ends_are_read() {
    let options = ReadOptions::default();
    let odd = ["nan", "-nan(ind)", "1.#QNAN", "-1.#IND00", "1.#INF", "nan(0x8000)", "-nan"];
    for word in odd {
        let text = format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv {word} 0 0\nf 1 2 3\nf 1 2 4\n");
        let loaded = formats::obj::read(source(text.as_bytes()), &options).expect(word);
        assert_eq!(loaded.scene.triangle_count(), 1, "{word}: {:?}", loaded.warnings);
        let ply = format!(
            "ply\rformat ascii 1.0\relement vertex 4\rproperty float x\rproperty float y\rproperty double z\relement face 2\rproperty list uchar int vertex_index\rend_header\r0 0 0\r1 0 0\r0 1 0\r0 {word} {word}\r3 0 1 2\r3 0 1 3\r"
        );
        let folder = in_folder(&[("a.ply", ply.as_bytes())]);
        let loaded = formats::read(&folder.path().join("a.ply"), &options).expect(word);
        assert_eq!(loaded.scene.triangle_count(), 1, "{word}");
    }
    for word in ["1.#QUIET", "nan(", "none", "1.#"] {
        let text = format!("v {word} 0 0\n");
        assert!(formats::obj::read(source(text.as_bytes()), &options).is_err(), "{word}");
    }
    let lines = ["# a", "v 0 0 0", "v 1 0 0", "", "v 0 1 0 \\", " 1 0 0", "f 1 2 3"];
    for end in ["\n", "\r\n", "\r"] {
        let text = lines.join(end);
        let loaded = formats::obj::read(source(text.as_bytes()), &options).expect("valid");
        assert_eq!(loaded.scene.triangle_count(), 1, "{end:?}");
        let error = formats::obj::read(source(format!("{text}{end}v x").as_bytes()), &options);
        assert!(error.expect_err("no number").to_string().contains("line 8"), "{end:?}");
    }
    let off = "OFF\r3 1 0\r0 0 0\r1 0 0\r0 1 0\r3 0 1 2\r";
    assert!(formats::off::read(source(off.as_bytes()), &options).is_ok());
}
