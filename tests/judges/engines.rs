//! The samples for engines, opened by the engines that run here.

use super::browser::{chromium, mesh};
use super::{bake, have, here, runs, runs_with};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;

/// A copy of the sample for an engine, with the trained scene in it.
pub(super) fn sample(engine: &str, flags: &[&str]) -> TempDir {
    sample_of(&here("samples/soups/trained.ply"), engine, flags)
}

/// A copy of the sample for an engine, with a scene in it.
pub(super) fn sample_of(source: &Path, engine: &str, flags: &[&str]) -> TempDir {
    let folder = TempDir::new().unwrap();
    for file in fs::read_dir(here("samples/engines").join(engine)).unwrap() {
        let file = file.unwrap().path();
        fs::copy(&file, folder.path().join(file.file_name().unwrap())).unwrap();
    }
    let scene = folder.path().join("scene.glb");
    bake(source, &scene, &[&["--collision"], flags].concat());
    folder
}

/// What a script of `tests/judges/godot4` says in a project, once Godot has imported its files.
pub(super) fn run_script(godot4: &Path, project: &Path, script: &str) -> String {
    fs::copy(here("tests/judges/godot4").join(script), project.join(script)).unwrap();
    runs(Command::new(godot4).arg(project).arg("--import"));
    let done = runs(Command::new(godot4).arg(project).args(["--script", script]));
    [done.stdout, done.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat()
}

/// Triangles of the collision node of a GLB.
pub(super) fn collision_faces(path: &Path) -> usize {
    let document = gltf::Gltf::open(path).unwrap();
    let node = document.nodes().find(|node| node.name() == Some("collision-colonly")).unwrap();
    node.mesh()
        .unwrap()
        .primitives()
        .map(|primitive| primitive.indices().unwrap().count() / 3)
        .sum()
}

/// How far a GLB's first viewpoint is from its subject, in units of the scene.
fn first_distance(path: &Path) -> f64 {
    let document = gltf::Gltf::open(path).unwrap();
    let camera = document.cameras().next().unwrap();
    let gltf::camera::Projection::Perspective(lens) = camera.projection() else {
        panic!("{}", path.display())
    };
    f64::from(lens.znear()) / 0.01
}

#[test]
fn godot_walker_starts_at_the_viewpoint_and_stays_on_the_floor() {
    let godot4 = here("target/judges/godot4");
    if !have("godot4", godot4.exists()) {
        return;
    }
    let folder = sample("godot4", &["--target", "godot"]);
    let said = run_script(&godot4, folder.path(), "walk.gd");
    let lines: Vec<Vec<&str>> = said.lines().map(|line| line.split(' ').collect()).collect();
    let of = |kind: &str| lines.iter().filter(|line| line[0] == kind).collect::<Vec<_>>();
    let faces = collision_faces(&folder.path().join("scene.glb")).to_string();
    assert!(
        !of("drawn").is_empty() && of("other").iter().all(|line| line[1] == "viewpoint"),
        "{}",
        said
    );
    assert!(of("drawn").iter().all(|line| !line[1].contains("collision")), "it is drawn: {}", said);
    assert_eq!(of("body"), [&vec!["body", "collision", faces.as_str()]], "{}", said);
    assert!(!said.contains("SCRIPT ERROR"), "{}", said);
    let [walker] = of("walker")[..] else { panic!("{}", said) };
    assert_eq!(walker[1], "true", "the walker stands on nothing: {}", said);
    let number = |kind: &str, at: usize| of(kind)[0][at].parse::<f64>().unwrap();
    // Two fifths of the way to the subject, whatever stands around it.
    let height = 0.4 * first_distance(&folder.path().join("scene.glb"));
    assert!((number("walker", 5) / height - 1.0).abs() < 1e-3, "{height}: {}", said);
    assert!(
        number("first", 1) < 0.01 && number("first", 2) < 0.01,
        "it begins elsewhere: {}",
        said
    );
    assert_eq!(of("first")[0][3], "true", "another camera draws: {}", said);
    // Heights; a step goes up to a slope before the body does.
    assert!(number("deepest", 1) < 0.25, "it falls through the floor: {}", said);
    assert_eq!(of("deepest")[0][2..], ["true", "true"], "{}", said);
    assert!(number("sank", 1).abs() < 0.01, "{}", said);
}

/// What the page of the sample says of itself, and pictures of `views`: see `tests/judges/sample.mjs`.
pub(super) fn open_page_sample(chromium: &Path, sample: &Path, views: Option<&Path>) -> Value {
    let mut command = Command::new("node");
    command
        .arg(here("tests/judges/sample.mjs"))
        .arg(here("target/judges"))
        .arg(chromium)
        .arg(sample)
        .args(views);
    let done = runs_with(&mut command, b"");
    serde_json::from_slice(&done.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&done.stderr)))
}

/// The browser, when it and the packages of the page sample are there.
pub(super) fn page_sample_judges() -> Option<PathBuf> {
    let three = here("target/judges/node_modules/three").exists();
    chromium().filter(|_| have("3d-tiles-renderer", three))
}

#[test]
fn the_page_sample_draws_the_scene_and_hits_its_surface() {
    let Some(chromium) = page_sample_judges() else { return };
    let folder = sample("three", &["--target", "web", "--set", "compress=true"]);
    let said = open_page_sample(&chromium, folder.path(), None);
    assert_eq!(said["errors"], json!([]), "{said}");
    let triangles = mesh(&folder.path().join("scene.glb")).0.face_count() as u64;
    let drawn = said["triangles"].as_u64().unwrap();
    // What is out of view is not drawn; the surface never is.
    assert!(drawn > triangles / 3 && drawn <= triangles, "{drawn} of {triangles}");
    assert!(said["target"].as_str().is_some_and(|target| target.split(',').count() == 3), "{said}");
}
