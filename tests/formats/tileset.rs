//! Tilesets that are checked: a sound one, and one fault at a time.

use glam::Vec3;
use serde_json::{Value, json};
use std::path::Path;
use trisplat::{Dataset, DatasetOptions};
use trisplat_bake::{Bake, BakeOptions, BakePreset, TilesOptions};
use trisplat_formats::{
    self as formats, Format, OutputOptions, ReadOptions,
    check::{Checked, Severity, check},
};
use trisplat_scene::mesh::{Colors, Mesh};

/// A tileset of five tiles: a ground of 60 by 60 squares, two triangles each.
fn tileset(folder: &Path) -> Value {
    tileset_of(folder, 2000, OutputOptions::DEFAULT.tileset_tiles)
}

/// The same ground in tiles of `triangles`, some of them in a file.
fn tileset_of(folder: &Path, tile_triangles: u32, tileset_tiles: u32) -> Value {
    let at = |x: u32, y: u32| Vec3::new(x as f32, 0.0, y as f32);
    let square = |i: u32| {
        let (x, y) = (i % 60, i / 60);
        [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y), at(x + 1, y + 1), at(x, y + 1)]
    };
    let positions: Vec<Vec3> = (0..3600).flat_map(square).collect();
    let colors = Colors::Face(vec![[0.5, 0.2, 0.1]; positions.len() / 3]);
    let mut options = BakeOptions::preset(BakePreset::Fast);
    options.tiles = TilesOptions { tiles: true, tile_triangles };
    let asset = Bake::new(&options).run([Mesh { positions, colors, ..Mesh::default() }]).unwrap();
    let output = OutputOptions { tileset_tiles, ..OutputOptions::DEFAULT };
    formats::write(&asset, &folder.join("a.tileset.json"), &output).unwrap();
    serde_json::from_slice(&std::fs::read(folder.join("a.tileset.json")).unwrap()).unwrap()
}

fn checked(folder: &Path, set: &Value) -> Checked {
    let path = folder.join("b.json");
    std::fs::write(&path, set.to_string()).unwrap();
    check(&path, &ReadOptions::default()).unwrap()
}

fn errors(checked: &Checked) -> Vec<String> {
    let is_error = |f: &&trisplat_formats::check::Finding| f.severity == Severity::Error;
    checked.findings.iter().filter(is_error).map(|f| format!("{}: {}", f.place, f.what)).collect()
}

#[test]
fn a_tileset_is_checked_with_all_its_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let set = tileset(folder.path());
    let sound = checked(folder.path(), &set);
    assert_eq!((sound.format, errors(&sound)), (Format::Tileset, Vec::new()), "{sound:?}");
    // Those of the root, which stand for all, and all.
    assert!(sound.triangles.unwrap() > 7200, "{sound:?}");

    let fault = |change: &dyn Fn(&mut Value), wanted: &str| {
        let mut set = set.clone();
        change(&mut set);
        let found = errors(&checked(folder.path(), &set));
        assert!(found.len() == 1 && found[0].contains(wanted), "{wanted}: {found:?}");
    };
    let child = "root.children[2]";
    fault(&|set| set["root"]["children"][2]["geometricError"] = json!(1e9), child);
    fault(&|set| set["root"]["children"][2]["content"]["uri"] = json!("none.glb"), "which does not exist");
    fault(&|set| set["root"]["children"][2]["refine"] = json!("MORE"), "ADD or REPLACE");
    fault(&|set| set["root"]["children"][2]["transform"] = moved(), "not within that of the tile above");
    fault(&|set| drop(set["root"].as_object_mut().unwrap().remove("refine")), "lacks `refine`");
    fault(
        &|set| drop(set["root"]["children"][2].as_object_mut().unwrap().remove("boundingVolume")),
        "boundingVolume",
    );
    fault(&|set| set["asset"]["version"] = json!("2.0"), "version 2.0");
    fault(&|set| set["root"]["children"][2]["content"]["uri"] = json!("../a.glb"), "`allow_outside`");
    let swapped = |set: &mut Value| {
        let other = set["root"]["children"][0]["content"].clone();
        set["root"]["children"][2]["content"] = other;
    };
    fault(&swapped, "triangles outside its box");
}

#[test]
fn a_large_tileset_is_one_of_tilesets_and_checked_with_them() {
    let [whole, split] = [(), ()].map(|()| tempfile::tempdir().unwrap());
    let one = checked(whole.path(), &tileset_of(whole.path(), 1000, 10_000));
    let set = tileset_of(split.path(), 1000, 5);
    let sound = checked(split.path(), &set);
    assert_eq!((errors(&sound), sound.triangles), (Vec::new(), one.triangles), "{sound:?}");

    // The root and four tilesets, of five tiles each.
    let parts = set["root"]["children"].as_array().unwrap();
    let part = parts[2]["content"]["uri"].as_str().unwrap();
    assert!(parts.len() == 4 && part.starts_with("a.tiles/set2-") && part.ends_with(".json"), "{part}");
    let path = split.path().join(part);
    let inner: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    assert_eq!(inner["root"]["children"].as_array().unwrap().len(), 4);
    assert_eq!(inner["root"]["geometricError"], parts[2]["geometricError"]);

    let whole = std::fs::read(&path).unwrap();
    let fault = |change: &dyn Fn(&mut Value), wanted: &str| {
        let mut inner = inner.clone();
        change(&mut inner);
        std::fs::write(&path, inner.to_string()).unwrap();
        let found = errors(&checked(split.path(), &set));
        let named = found.iter().all(|error| error.contains(part));
        assert!(found.len() == 1 && named && found[0].contains(wanted), "{wanted}: {found:?}");
    };
    fault(&|inner| inner["root"]["children"][1]["geometricError"] = json!(1e9), "root.children[1]");
    fault(&|inner| inner["root"]["geometricError"] = json!(1e9), "must not grow downwards");
    fault(&|inner| inner["root"]["transform"] = moved(), "not within that of the tile above");
    fault(
        &|inner| inner["root"]["children"][1]["content"]["uri"] = json!("none.glb"),
        "which does not exist",
    );
    fault(&|inner| *inner = json!([]), "is no tileset");
    let name = path.file_name().unwrap().to_str().unwrap();
    fault(&|inner| inner["root"]["children"][1]["content"]["uri"] = json!(name), "the tileset that it is in");

    // Parts of an earlier tileset go with its tiles; one that somebody changed stays.
    tileset_of(split.path(), 2000, 5);
    assert!(path.exists());
    std::fs::write(&path, whole).unwrap();
    tileset_of(split.path(), 2000, 5);
    assert!(!path.exists());
}

/// Ten thousand units to the side.
fn moved() -> Value {
    json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 1e4, 0, 0, 1])
}

#[test]
fn a_broken_tile_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let set = tileset(folder.path());
    let name = set["root"]["children"][1]["content"]["uri"].as_str().unwrap().to_owned();
    let path = folder.path().join(&name);
    let whole = std::fs::read(&path).unwrap();
    std::fs::write(&path, &whole[..whole.len() / 2]).unwrap();
    let found = errors(&checked(folder.path(), &set));
    assert!(!found.is_empty() && found.iter().all(|error| error.starts_with(&name)), "{found:?}");
}

#[test]
fn where_a_scene_or_photos_are_wanted_a_tileset_says_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    tileset(folder.path());
    let path = folder.path().join("a.tileset.json");
    let scene = formats::read(&path, &ReadOptions::default()).unwrap_err();
    let photos = Dataset::load(&path, &DatasetOptions::default()).unwrap_err();
    for message in [scene.to_string(), photos.to_string()] {
        assert!(message.contains("a.tileset.json: is a tileset (3D Tiles)"), "{message}");
        assert!(message.contains("trisplat validate") && !message.contains('\n'), "{message}");
    }
}

#[test]
fn tilesets_nested_thousands_deep_are_checked_and_counted_or_refused_with_the_remedy() {
    let folder = tempfile::tempdir().unwrap();
    let at = |i: u32| folder.path().join(format!("{i}.json"));
    let set = |uri: &str| {
        json!({ "asset": { "version": "1.1" }, "geometricError": 1.0, "root": {
            "boundingVolume": { "box": [0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1] }, "geometricError": 1.0,
            "refine": "ADD", "content": { "uri": uri },
        } })
    };
    (0..4097).for_each(|i| std::fs::write(at(i), set(&format!("{}.json", i + 1)).to_string()).unwrap());
    let last = at(3000);
    std::fs::write(&last, set("none.glb").to_string()).unwrap();
    let options = ReadOptions::default();
    let found = check(&at(0), &options).unwrap();
    assert!(
        errors(&found).len() == 1 && errors(&found)[0].contains("none.glb, which does not exist"),
        "{found:?}"
    );
    let info = formats::tileset_info(&at(0), &options.limits, false).unwrap().unwrap();
    assert_eq!((info.tilesets, info.tiles, info.missing), (3001, 1, 1));

    std::fs::write(&last, set("3001.json").to_string()).unwrap();
    let told = |error: trisplat::Error| {
        let error = error.to_string();
        assert!(error.contains("4096.json: 4097 levels") && error.contains("nesting=4097"), "{error}");
    };
    told(check(&at(0), &options).unwrap_err());
    told(formats::tileset_info(&at(0), &options.limits, false).unwrap_err());
}
