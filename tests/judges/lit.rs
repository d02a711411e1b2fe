//! Scenes that lights fall on, in the judges' hands.

use super::{assert_valid, bake, have, here, runs, validator};
use std::fs;
use std::process::Command;
use tempfile::TempDir;

#[test]
fn lit_scenes_are_valid_gltf() {
    if !validator() {
        return;
    }
    let folder = TempDir::new().unwrap();
    let trained = here("samples/soups/trained.ply");
    let photos = here("samples/dataset").display().to_string();
    let cases: [(&str, &[&str]); 5] = [
        ("plain.glb", &["--lit"]),
        ("flat.gltf", &["--lit=flat", "--set", "weld=on"]),
        ("godot.glb", &["--lit", "--target", "godot"]),
        ("small.glb", &["--lit", "--target", "blender", "--set", "compress=true"]),
        (
            "backdrop.glb",
            &[
                "--lit",
                "--target",
                "unity",
                "--set",
                "compress=true",
                "--backdrop",
                "sphere",
                "--dataset",
                &photos,
            ],
        ),
    ];
    let files = cases.map(|(name, flags)| {
        let path = folder.path().join(name);
        let triangles = bake(&trained, &path, flags);
        (path, triangles)
    });
    assert_valid(&files);
}

#[test]
fn godot_lights_a_lit_scene() {
    let godot4 = here("target/judges/godot4");
    if !have("godot4", godot4.exists()) {
        return;
    }
    let folder = TempDir::new().unwrap();
    for file in ["project.godot", "dump.gd"] {
        fs::copy(here("tests/judges/godot4").join(file), folder.path().join(file)).unwrap();
    }
    let scene = folder.path().join("scene.glb");
    bake(&here("samples/soups/trained.ply"), &scene, &["--lit", "--target", "godot"]);
    let said = ["--import", "--script=dump.gd"].map(|what| {
        let done = runs(Command::new(&godot4).arg(folder.path()).args(what.split('=')));
        String::from_utf8_lossy(&done.stdout).into_owned()
    });
    let lines: Vec<&str> = said[1].lines().filter(|line| line.starts_with("lit ")).collect();
    assert!(!lines.is_empty() && lines.iter().all(|line| line.ends_with(" true")), "{}", said[1]);
}
