//! Viewers that step back until everything is in the picture see the scene, not the backdrop around
//! it.

use super::browser::chromium;
use super::engines::{run_script, sample};
use super::{bake, have, here, runs};
use serde_json::{Value, json};
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// The shares of the picture when a viewer frames a file: "scene", "kept" and "ball" of
/// tests/judges/framing.mjs.
fn framed(viewer: &str, chromium: &Path, scene: &Path) -> Value {
    let mut command = Command::new("node");
    command
        .arg(here("tests/judges/framing.mjs"))
        .arg(here("target/judges"))
        .arg(chromium)
        .arg(viewer)
        .arg(scene);
    let done = runs(&mut command);
    let said: Value = serde_json::from_slice(&done.stdout)
        .unwrap_or_else(|_| panic!("{viewer}: {}", String::from_utf8_lossy(&done.stderr)));
    assert_eq!(said["errors"], json!([]), "{viewer}");
    said
}

fn assert_seen(viewer: &str, chromium: &Path, [scene, subject]: [&Path; 2], least: f64) {
    let alone = framed(viewer, chromium, subject);
    assert!(
        alone["scene"].as_f64().unwrap() > least && alone["ball"] == 0,
        "{viewer}, the subject alone: {alone}"
    );
    let said = framed(viewer, chromium, scene);
    let share = |key: &str| said[key].as_f64().unwrap();
    assert!(share("ball") > 0.005, "{viewer}: there is a backdrop around the scene: {said}");
    assert!(share("scene") > 0.02, "{viewer}: the scene is in the picture: {said}");
    assert!(share("kept") > 0.97, "{viewer}: the backdrop hides the scene: {said}");
}

#[test]
fn three_and_babylon_show_the_scene_when_they_frame_the_file() {
    let judges = here("target/judges/node_modules");
    let Some(chromium) = chromium() else { return };
    let folder = TempDir::new().unwrap();
    let scene = folder.path().join("scene.glb");
    let photos = here("samples/dataset").display().to_string();
    bake(
        &here("samples/soups/trained.ply"),
        &scene,
        &["--dataset", &photos, "--backdrop", "sphere"],
    );
    let subject = folder.path().join("subject.glb");
    bake(
        &here("samples/soups/trained.ply"),
        &subject,
        &["--dataset", &photos, "--crop", "subject"],
    );
    // The crate on its piece of floor fills 20% and 6%, a cube 16% in Babylon.js.
    if have("3d-tiles-renderer", judges.join("three").exists()) {
        assert_seen("three", &chromium, [&scene, &subject], 0.15);
    }
    if have("babylon", judges.join("babylonjs").exists()) {
        assert_seen("babylon", &chromium, [&scene, &subject], 0.05);
    }
}

/// However far back the editor steps from what is selected.
#[test]
fn godot_backdrop_is_a_node_that_hides_nothing_from_beyond() {
    let godot4 = here("target/judges/godot4");
    if !have("godot4", godot4.exists()) {
        return;
    }
    let photos = here("samples/dataset").display().to_string();
    let flags = ["--target", "godot", "--dataset", &photos, "--backdrop", "sphere"];
    let folder = sample("godot4", &flags);
    let said = run_script(&godot4, folder.path(), "sides.gd");
    let nodes = || said.lines().filter_map(|line| line.strip_prefix("node "));
    assert!(nodes().any(|node| node == "backdrop false"), "{said}");
    let scene: Vec<&str> = nodes().filter(|node| !node.starts_with("backdrop")).collect();
    // What photos saw from one side is drawn from there, the rest from both.
    assert_eq!(scene, ["scene true", "scene_front false"], "{said}");
}
