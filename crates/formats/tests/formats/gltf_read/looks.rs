//! Features that change the look of a file: skeletons, hidden nodes, samplers, glass.

use super::files::{Builder, UNSIGNED_BYTE, mesh};
use glam::{UVec2, Vec2, Vec3};
use serde_json::{Value, json};
use trisplat_formats::{ReadOptions, gltf};
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Asset, Provenance, TexelFilter};

/// A figure as Mixamo writes it: a skeleton of 100, joints of 0.01, vertices in metres. Joint 0
/// stands at (2, 0, 0), joint 1 at (2, 3, 0).
fn figure() -> Builder {
    let mut b = Builder::triangle();
    let joints = b.accessor(UNSIGNED_BYTE, "VEC4", 3, &[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0]);
    let weights = b.floats("VEC4", &[1., 0., 0., 0., 1., 0., 0., 0., 0.5, 0.5, 0., 0.]);
    let attributes = &mut b.json["meshes"][0]["primitives"][0]["attributes"];
    attributes["JOINTS_0"] = joints.into();
    attributes["WEIGHTS_0"] = weights.into();
    b.json["nodes"][0] = json!({ "mesh": 0, "skin": 0, "translation": [7, 7, 7] });
    let hip = b.push("nodes", json!({ "translation": [0.02, 0, 0], "scale": [0.01, 0.01, 0.01] }));
    let spine =
        b.push("nodes", json!({ "translation": [0.02, 0.03, 0], "scale": [0.01, 0.01, 0.01] }));
    b.node(json!({ "scale": [100, 100, 100], "children": [hip, spine] }));
    b.push("skins", json!({ "joints": [hip, spine] }));
    b
}

#[test]
fn skinned_mesh_stands_where_its_joints_rest() {
    let mut b = figure();
    let near = |got: [Vec3; 3], wants: [Vec3; 3]| {
        assert!(got.iter().zip(wants).all(|(a, b)| a.distance(b) < 1e-5), "{got:?} {wants:?}");
    };
    // The transform of the node itself does not count.
    let wants = [Vec3::X * 2.0, Vec3::new(3.0, 3.0, 0.0), Vec3::new(2.0, 2.5, 0.0)];
    near(b.mesh_of().corners(0), wants);
    // Bound where it stands: a matrix of columns takes the joints' places back.
    let bound = |x: f32, y: f32| [1., 0., 0., 0., 0., 1., 0., 0., 0., 0., 1., 0., x, y, 0., 1.];
    let matrices: Vec<u8> = [bound(-2.0, 0.0), bound(-2.0, -3.0)]
        .concat()
        .iter()
        .flat_map(|x: &f32| x.to_le_bytes())
        .collect();
    let accessor = b.accessor(5126, "MAT4", 2, &matrices);
    b.json["skins"][0]["inverseBindMatrices"] = accessor.into();
    near(b.mesh_of().corners(0), [Vec3::ZERO, Vec3::X, Vec3::Y]);
    // A mirrored skeleton turns faces around, as a mirrored node does.
    b.json["nodes"][3]["scale"] = json!([-100, 100, 100]);
    assert_eq!(b.mesh_of().corners(0)[1], Vec3::Y);
}

#[test]
fn skin_that_does_not_fit_leaves_the_mesh_in_place() {
    type Edit = fn(&mut Builder);
    let cases: [(Edit, &str); 4] = [
        (|b| b.json["nodes"][0]["skin"] = 3.into(), "skin 3 does not exist"),
        (|b| b.json["skins"][0]["joints"] = json!([1, 99]), "not in the scene"),
        (|b| b.json["skins"][0]["inverseBindMatrices"] = 0.into(), "no matrix for each joint"),
        (|b| b.json["skins"][0]["joints"] = json!([1]), "name no joints"),
    ];
    for (edit, wants) in cases {
        let mut b = figure();
        edit(&mut b);
        let loaded = b.read().expect("valid");
        assert!(loaded.warnings[0].contains(wants), "{wants}: {:?}", loaded.warnings);
        assert_eq!(mesh(loaded).corners(0)[0], Vec3::splat(7.0), "{wants}");
    }
}

#[test]
fn hidden_nodes_are_left_out_with_all_below_them() {
    let mut b = Builder::triangle();
    b.json["extensionsUsed"] = json!(["KHR_node_visibility"]);
    b.json["extensionsRequired"] = json!(["KHR_node_visibility"]);
    let child = b.push("nodes", json!({ "mesh": 0, "translation": [0, 0, 9] }));
    b.node(json!({ "children": [child], "extensions": { "KHR_node_visibility": { "visible": false } } }));
    b.node(json!({ "mesh": 0, "extensions": { "KHR_node_visibility": { "visible": true } } }));
    assert_eq!(b.mesh_of().face_count(), 2);
    b.json["nodes"][2]["extensions"] = json!({ "KHR_node_visibility": {} });
    assert_eq!(b.mesh_of().face_count(), 3, "visible unless it says otherwise");
}

/// A triangle with a palette of two texels and a sampler; places are far inside the second one.
fn palette(sampler: Value, uvs: [f32; 6]) -> Builder {
    let mut b = Builder::triangle();
    let rgb = vec![[0, 0, 255], [255, 0, 0]];
    let picture = RgbImage { size: UVec2::new(2, 1), rgb, alpha: None };
    let view = b.view(&picture.to_png().expect("a picture"));
    let image = b.push("images", json!({ "bufferView": view, "mimeType": "image/png" }));
    let sampler = b.push("samplers", sampler);
    b.push("textures", json!({ "source": image, "sampler": sampler }));
    b.push("materials", json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } } }));
    let uv = b.floats("VEC2", &uvs);
    let primitive = &mut b.json["meshes"][0]["primitives"][0];
    primitive["material"] = 0.into();
    primitive["attributes"] =
        json!({ "POSITION": primitive["attributes"]["POSITION"], "TEXCOORD_0": uv });
    b
}

#[test]
fn nearest_samplers_and_png_stay_through_a_file() {
    let corner = [0.55, 0.5, 0.6, 0.5, 0.55, 0.9];
    for (mag, min, filter) in [
        (9728, json!(9728), TexelFilter::Nearest),
        (9728, Value::Null, TexelFilter::Nearest),
        (9728, json!(9986), TexelFilter::NearestOfLevel),
        (9729, json!(9987), TexelFilter::Linear),
    ] {
        let b = palette(json!({ "magFilter": mag, "minFilter": min }), corner);
        let mesh_read = b.mesh_of();
        let asset = Asset { mesh: mesh_read.clone(), ..Asset::default() };
        let bytes = gltf::to_glb_bytes(&asset, &gltf::GltfOptions::default()).expect("writes");
        let loaded = super::files::read_bytes(&bytes).expect("valid");
        let again = mesh(loaded);
        for texture in [&mesh_read, &again].map(|mesh| mesh.texture.as_ref().expect("kept")) {
            let page = &texture.pages[0];
            assert_eq!((page.style.filter, page.style.is_exact), (filter, true));
            let red = page.sample(texture.uvs[0][0], 0.0) == [1.0, 0.0, 0.0];
            assert_eq!(red, filter != TexelFilter::Linear, "linear mixes two colours");
            let far = page.sample(Vec2::new(0.55, 0.5), 1.0) == [1.0, 0.0, 0.0];
            assert_eq!(far, filter == TexelFilter::Nearest, "{filter:?}");
        }
        let text = String::from_utf8_lossy(&bytes).into_owned();
        assert!(text.contains("image/png") && !text.contains("image/jpeg"));
    }
}

#[test]
fn nearest_picture_that_repeats_stays_nearest_in_its_atlas() {
    for wrap in [33071, 33648, 10497] {
        let sampler = json!({ "magFilter": 9728, "minFilter": 9728, "wrapS": wrap, "wrapT": wrap });
        let mesh = palette(sampler, [0.5, 0.0, 3.0, 0.0, 0.5, 2.0]).mesh_of();
        let texture = mesh.texture.as_ref().expect("kept");
        assert_eq!(texture.style().filter, TexelFilter::Nearest);
        assert!(texture.style().is_exact);
        let between = texture.uvs[0][0] * 0.9 + texture.uvs[0][1] * 0.1;
        let wants = [1.0, 0.0, 0.0];
        assert_eq!(texture.texture(0).sample(between, 0.0), wants, "0.75 of the picture");
    }
}

#[test]
fn one_picture_with_two_samplers_becomes_two_pages() {
    let mut b = palette(json!({ "magFilter": 9728 }), [0.6, 0.5, 0.7, 0.5, 0.6, 0.6]);
    let linear = b.push("samplers", json!({}));
    b.push("textures", json!({ "source": 0, "sampler": linear }));
    b.push("materials", json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": 1 } } }));
    let mut other = b.json["meshes"][0]["primitives"][0].clone();
    other["material"] = 1.into();
    b.json["meshes"][0]["primitives"].as_array_mut().expect("a list").push(other);
    let mesh_read = b.mesh_of();
    let pages = &mesh_read.texture.as_ref().expect("kept").pages;
    let filters: Vec<TexelFilter> = pages.iter().map(|page| page.style.filter).collect();
    assert_eq!(filters, [TexelFilter::Nearest, TexelFilter::Linear]);
    let asset = Asset { mesh: mesh_read, ..Asset::default() };
    let bytes = gltf::to_glb_bytes(&asset, &gltf::GltfOptions::default()).expect("writes");
    let again = mesh(super::files::read_bytes(&bytes).expect("valid"));
    let pages = again.texture.expect("kept").pages;
    assert_eq!(pages.iter().map(|page| page.style.filter).collect::<Vec<_>>(), filters);
}

#[test]
fn extensions_that_change_the_look_are_named() {
    let named = |extensions: Value| {
        let mut b = Builder::triangle();
        b.push("materials", json!({ "doubleSided": true, "extensions": extensions }));
        b.json["meshes"][0]["primitives"][0]["material"] = 0.into();
        b.read().expect("valid").warnings.join("; ")
    };
    for name in ["KHR_materials_transmission", "KHR_materials_diffuse_transmission"] {
        for key in ["transmissionFactor", "diffuseTransmissionFactor"] {
            let text = named(json!({ name: { key: 0.5 }, "KHR_materials_volume": {} }));
            assert_eq!(text, format!("{name} is not read: glass becomes opaque"));
        }
        assert_eq!(named(json!({ name: {} })), "", "a factor of 0 changes nothing");
    }
    for name in ["anisotropy", "clearcoat", "iridescence", "sheen", "specular"] {
        let text = named(json!({ format!("KHR_materials_{name}"): {} }));
        assert!(text.contains("look plainer: KHR_materials_") && text.ends_with(name), "{text}");
    }
    for name in
        ["unlit", "emissive_strength", "pbrSpecularGlossiness", "ior", "volume", "dispersion"]
    {
        assert_eq!(
            named(json!({ format!("KHR_materials_{name}"): { "emissiveStrength": 1 } })),
            ""
        );
    }
    let mut b = Builder::triangle();
    b.json["meshes"][0]["primitives"][0]["extensions"] = json!({ "KHR_materials_variants": {} });
    assert!(b.read().expect("valid").warnings[0].contains("default materials"));
}

#[test]
fn gaussians_beside_a_mesh_are_counted() {
    let mut b = Builder::triangle();
    let position = b.floats("VEC3", &[0.5; 12]);
    let splats = json!({ "attributes": { "POSITION": position }, "mode": 0, "extensions": { "KHR_gaussian_splatting": {} } });
    b.json["extensionsUsed"] = json!(["KHR_gaussian_splatting"]);
    let number = b.mesh(splats);
    b.node(json!({ "mesh": number }));
    let loaded = b.read().expect("valid");
    assert!(loaded.warnings[0].starts_with("4 Gaussians beside the mesh"), "{:?}", loaded.warnings);
    assert_eq!(
        loaded.provenance,
        Provenance {
            up: loaded.provenance.up,
            generator: Some("by hand".into()),
            ..Provenance::default()
        }
    );
    let options = ReadOptions::default();
    let content =
        trisplat_formats::read_content_bytes(&b.glb(), trisplat_formats::Format::Glb, &options);
    assert!(matches!(content, Ok(trisplat_formats::Content::Scene(_))));
}
