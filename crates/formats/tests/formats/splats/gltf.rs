//! Gaussians in glTF.

use super::*;

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
    assert!(!mesh.warnings.iter().any(|warning| warning.contains("Gaussian")), "both are read");
    let mesh = trisplat_formats::read(&path, &ReadOptions::default()).expect("valid");
    let says =
        "1 Gaussian beside the mesh is left out; `trisplat bake` makes triangles of them too";
    assert!(mesh.warnings.iter().any(|warning| warning == says), "{:?}", mesh.warnings);
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
