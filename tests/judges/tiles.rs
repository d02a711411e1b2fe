//! A tileset in 3DTilesRendererJS: what it loads falls with the distance.

use super::browser::chromium;
use super::{bake, have, here, runs_with, studio};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;
use std::process::Command;
use tempfile::TempDir;

/// What the viewer draws from each of `views`, which are eyes and targets, Z-up: see
/// `tests/judges/tiles.mjs`.
fn visit(chromium: &Path, tileset: &Path, views: &Value) -> Vec<Value> {
    let mut command = Command::new("node");
    command
        .arg(here("tests/judges/tiles.mjs"))
        .arg(here("target/judges"))
        .arg(chromium)
        .arg(tileset);
    let job = json!({ "size": [640, 480], "error": 16, "views": views });
    let done = runs_with(&mut command, job.to_string().as_bytes());
    let said: Value = serde_json::from_slice(&done.stdout)
        .unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&done.stderr)));
    assert_eq!(said["errors"], json!([]));
    said["views"].as_array().unwrap().clone()
}

#[test]
fn fewer_triangles_are_loaded_from_farther_away() {
    streams(&[]);
}

#[test]
fn a_tileset_of_tilesets_streams_as_one() {
    // Four tilesets of five tiles each below the first.
    streams(&["--set", "tileset_tiles=5"]);
}

fn streams(flags: &[&str]) {
    let there = here("target/judges/node_modules/3d-tiles-renderer").exists();
    let Some(chromium) = chromium().filter(|_| have("3d-tiles-renderer", there)) else { return };
    let folder = TempDir::new().unwrap();
    let tileset = folder.path().join("studio.tileset.json");
    let flags = [&["--set", "tile_triangles=1000"], flags].concat();
    let triangles = bake(&studio(), &tileset, &flags);
    let set: Value = serde_json::from_slice(&fs::read(&tileset).unwrap()).unwrap();
    let volume: Vec<f64> =
        serde_json::from_value(set["root"]["boundingVolume"]["box"].clone()).unwrap();
    let size = 2.0 * volume[3].max(volume[7]).max(volume[11]);
    let eye = |distance: f64| [volume[0], volume[1] - size * distance, volume[2] + 0.3 * size];
    let distances = [0.7, 1.5, 3.0, 6.0, 12.0, 40.0];
    let views = distances.map(|distance| json!({ "eye": eye(distance), "target": &volume[..3] }));
    let seen = visit(&chromium, &tileset, &json!(views));
    let drawn: Vec<u64> = seen.iter().map(|view| view["triangles"].as_u64().unwrap()).collect();
    assert!(drawn.windows(2).all(|pair| pair[0] >= pair[1]), "{drawn:?}");
    assert!(drawn[0] > triangles / 2, "{drawn:?} of {triangles}");
    let root = seen.last().unwrap();
    assert!(root["tiles"] == 1 && root["triangles"].as_u64().unwrap() <= 1000, "{root}");
    // Every level is drawn from somewhere.
    assert!(
        drawn.iter().any(|some| (1000..triangles / 2).contains(some)),
        "{drawn:?} of {triangles}"
    );
}
