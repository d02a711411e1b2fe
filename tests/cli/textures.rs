//! `--texture` as typed: on, or where the photos decide.

use super::train::dataset;
use super::{sample, stderr, trisplat};
use serde_json::Value;

/// The file, the details of its texture, and what was said of a bake of the sample with its photos.
fn baked(flags: &[&str]) -> (Vec<u8>, Value, String) {
    let folder = tempfile::tempdir().unwrap();
    let [glb, report] = ["a.glb", "a.json"].map(|name| folder.path().join(name));
    let scene = sample("trained.ply");
    let photos = dataset();
    let mut words: Vec<&dyn AsRef<std::ffi::OsStr>> =
        vec![&"bake", &scene, &"--dataset", &photos, &"--preset", &"fast", &"--max-size", &"60"];
    words.extend([&"-o" as &dyn AsRef<std::ffi::OsStr>, &glb, &"--report", &report]);
    words.extend(flags.iter().map(|flag| flag as &dyn AsRef<std::ffi::OsStr>));
    let output = trisplat(&words);
    assert!(output.status.success(), "{}", stderr(&output));
    let report: Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    let stage = report["stages"]
        .as_array()
        .unwrap()
        .iter()
        .find(|stage| stage["name"] == "texture")
        .unwrap();
    (std::fs::read(glb).unwrap(), stage.clone(), stderr(&output))
}

/// Whether triangles show a picture, or colours.
fn has_picture(glb: &[u8]) -> bool {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    let document: Value = serde_json::from_slice(&glb[20..20 + length]).unwrap();
    let [picture, colors] = ["TEXCOORD_0", "COLOR_0"]
        .map(|name| !document["meshes"][0]["primitives"][0]["attributes"][name].is_null());
    assert!(picture != colors && picture == document["images"].is_array(), "{document}");
    picture
}

/// Whether the colours were closer to photos that decided nothing, by both measures.
fn colors_won(stage: &Value) -> bool {
    let figure =
        |name: &str| stage["details"][name].as_f64().unwrap_or_else(|| panic!("{name}: {stage}"));
    ["psnr", "ssim"]
        .iter()
        .all(|of| figure(&format!("{of}_before")) > figure(&format!("{of}_after")))
}

#[test]
fn photos_decide_whether_auto_writes_a_texture() {
    // Thousands of triangles with a colour per corner are closer than texels, hundreds are not.
    for (most, wants_picture) in [("8000", false), ("300", true)] {
        let (glb, stage, said) = baked(&["--texture=auto", "--max-triangles", most]);
        assert_eq!(colors_won(&stage), !wants_picture, "{stage}");
        assert_eq!(has_picture(&glb), wants_picture, "{stage}");
        assert_eq!(stage["skipped"].is_null(), wants_picture, "{stage}");
        assert!(!said.contains("warning: the colours"), "{said}");
    }
}

#[test]
fn who_asks_for_a_texture_gets_one_and_hears_what_photos_prefer() {
    let (glb, stage, said) = baked(&["--texture"]);
    assert!(colors_won(&stage) && has_picture(&glb), "{stage}");
    assert!(
        said.contains("warning: the colours were closer to the photos than the texture"),
        "{said}"
    );
    assert!(said.contains("without --texture, or with its value `auto`"), "{said}");
}
