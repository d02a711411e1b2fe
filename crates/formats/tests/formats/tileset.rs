//! Tilesets where something else is wanted.

use serde_json::json;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::{self as formats, ReadOptions};

#[test]
fn where_a_scene_or_photos_are_wanted_a_tileset_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tileset.json");
    let set = json!({ "asset": { "version": "1.1" }, "geometricError": 1.0, "root": {} });
    std::fs::write(&path, set.to_string()).unwrap();
    let scene = formats::read(&path, &ReadOptions::default()).unwrap_err();
    let photos = Dataset::load(&path, &DatasetOptions::default()).unwrap_err();
    for message in [scene.to_string(), photos.to_string()] {
        assert!(message.contains("a.tileset.json: is a tileset (3D Tiles)"), "{message}");
        assert!(
            message.contains("give one of the files it names") && !message.contains('\n'),
            "{message}"
        );
    }
}
