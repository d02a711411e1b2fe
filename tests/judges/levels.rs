//! What engines get for levels of detail, opened by those that run here; scripts for others are
//! checked as far as can be.

use super::editors::{compile_for_unity, has_mcs};
use super::{bake, have, here, python, runs, studio};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// A sample in three levels for a target, in chunks; the triangles of each and of its backdrop.
fn levels(folder: &Path, input: &Path, name: &str, target: &str) -> [[u64; 2]; 3] {
    let scene = folder.join(name);
    let flags = ["--target", target, "--lod", "0.5,0.1", "--set", "chunk_triangles=1000"];
    bake(input, &scene, &flags);
    ["glb", "lod1.glb", "lod2.glb"].map(|ending| {
        let document = gltf::Gltf::open(scene.with_extension(ending)).unwrap();
        let corners = |p: gltf::Primitive<'_>| {
            p.indices().or(p.get(&gltf::Semantic::Positions)).unwrap().count()
        };
        [false, true].map(|behind| {
            let meshes =
                document.meshes().filter(|mesh| (mesh.name() == Some("backdrop")) == behind);
            let primitives = meshes.flat_map(|mesh| mesh.primitives().collect::<Vec<_>>());
            primitives.map(corners).sum::<usize>() as u64 / 3
        })
    })
}

#[test]
fn godot_draws_each_level_within_its_range() {
    let judges = ["godot4", "godot4-screen"].map(|judge| here("target/judges").join(judge));
    if !have("godot4-screen", judges[1].exists()) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let triangles = levels(folder.path(), &here("samples/soups/trained.ply"), "scene.glb", "godot");
    for file in ["project.godot", "levels.gd"] {
        fs::copy(here("tests/judges/godot4").join(file), folder.path().join(file)).unwrap();
    }
    runs(Command::new(&judges[0]).arg(folder.path()).arg("--import"));
    let mut draw = Command::new(&judges[1]);
    draw.arg(folder.path()).args([
        "--rendering-method",
        "gl_compatibility",
        "--script",
        "levels.gd",
    ]);
    let done = runs(&mut draw);
    let said =
        [done.stdout, done.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(!said.contains("ERROR"), "{said}");
    let lines = said.lines().filter_map(|line| line.strip_prefix("drawn "));
    let drawn: Vec<(f64, u64)> = lines
        .map(|line| {
            line.split_once(' ').map(|(at, n)| (at.parse().unwrap(), n.parse().unwrap())).unwrap()
        })
        .collect();
    let [[all, behind], [half, of_half], [tenth, of_tenth]] = triangles;
    assert!(behind > 0 && of_half == behind && of_tenth == behind, "{triangles:?}");
    let [all, half, tenth] = [all, half, tenth].map(|level| level + behind);
    let seen: Vec<u64> = drawn.iter().map(|(_, triangles)| *triangles).collect();
    // From far off to the edge of each range, each level whole and alone before one backdrop.
    assert_eq!(seen[..5], [tenth, tenth, half, half, all], "{said}");
    // Within the scene chunks are skipped that are out of view.
    assert!(seen.len() == 6 && seen[5] > 0 && seen[5] < all, "{said}");
}

#[test]
fn the_script_for_unity_compiles() {
    if !has_mcs() {
        return;
    }
    let folder = TempDir::new().unwrap();
    // A name that is none of a class.
    levels(folder.path(), &studio(), "my-room.glb", "unity");
    let sources =
        [folder.path().join("my-room.lod.cs"), here("samples/engines/unity/TrisplatScene.cs")];
    compile_for_unity(&folder.path().join("checked.dll"), &sources);
}

#[test]
fn the_script_for_unreal_makes_one_mesh_of_all_levels() {
    let Some(mut command) = python("trimesh") else { return };
    let folder = TempDir::new().unwrap();
    levels(folder.path(), &studio(), "my-room.glb", "unreal");
    let script = folder.path().join("my-room.lod.py");
    let done = runs(command.arg(&script).env("PYTHONPATH", here("tests/judges/unreal")));
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let said: Value = serde_json::from_slice(&done.stdout).unwrap();
    let files = ["my-room.glb", "my-room.lod1.glb", "my-room.lod2.glb"]
        .map(|name| folder.path().join(name));
    let files = files.map(|path| fs::canonicalize(path).unwrap());
    let imported: Vec<_> =
        said["imported"].as_array().unwrap().iter().map(|path| path.as_str().unwrap()).collect();
    assert_eq!(imported, files.each_ref().map(|path| path.to_str().unwrap()), "{said}");
    assert!(said["levels"][0][1] == 1 && said["levels"][1][1] == 2, "{said}");
    assert_eq!(said["saved"], said["levels"][0][0], "{said}");
    let sizes: Vec<f64> = serde_json::from_value(said["sizes"].clone()).unwrap();
    assert!(sizes.len() == 3 && sizes.windows(2).all(|pair| pair[0] > pair[1]), "{said}");
}
