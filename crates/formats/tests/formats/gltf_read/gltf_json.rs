//! Losses of `gltf-json` 1.4 that the reader does not have. A failure here says that the
//! crate has become better: read into its types then (`crates/formats/src/gltf/document.rs`).

use super::files::Builder;
use gltf_json::Root;
use gltf_json::validation::Checked;
use serde_json::{Value, json};

fn theirs(json: &Value) -> Result<Root, gltf_json::Error> {
    Root::from_str(&json.to_string())
}

#[test]
fn it_takes_indices_modulo_2_to_the_32() {
    let mut b = Builder::triangle();
    b.json["nodes"][0]["mesh"] = (1u64 << 32).into();
    assert_eq!(theirs(&b.json).expect("read").nodes[0].mesh.expect("a mesh").value(), 0);
    let error = b.read().expect_err("no such mesh").to_string();
    assert!(error.contains("shows mesh 4294967296, but the file has 1"), "{error}");
}

#[test]
fn it_forgets_codes_that_it_does_not_know() {
    let mut b = Builder::triangle();
    b.json["accessors"][0]["componentType"] = 5124.into();
    let accessors = theirs(&b.json).expect("read").accessors;
    assert!(matches!(accessors[0].component_type, Checked::Invalid));
    assert!(b.read().expect_err("unknown").to_string().contains("5124"));
}

#[test]
fn it_refuses_scenes_without_nodes() {
    let mut b = Builder::triangle();
    b.push("scenes", json!({ "name": "empty" }));
    assert!(theirs(&b.json).is_err());
    b.mesh_of();
}

#[test]
fn it_refuses_a_mesh_for_a_fault_elsewhere() {
    for (list, fault) in [
        ("animations", json!({})),
        ("samplers", json!({ "magFilter": "LINEAR" })),
        ("skins", json!({})),
        ("images", json!({ "mimeType": 7 })),
    ] {
        let mut b = Builder::triangle();
        b.push(list, fault);
        assert!(theirs(&b.json).is_err(), "{list}");
        b.mesh_of();
    }
}

#[test]
fn it_makes_large_objects_of_few_bytes() {
    assert!(size_of::<gltf_json::Material>() > 700, "a material of three bytes of JSON");
}
