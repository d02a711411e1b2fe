//! Plans, tasks, merges and tilesets at the command line, on a small scene.

use serde_json::Value;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use tempfile::TempDir;
use trisplat_fixtures::{folders::copy_folder, samples, shared::shared};

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    command
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn succeed(folder: &Path, arguments: &[&str]) -> String {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", stderr(&output));
    stderr(&output)
}

fn fail(folder: &Path, arguments: &[&str], needles: &[&str]) {
    let output = run(folder, arguments);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(needles.iter().all(|needle| said.contains(needle)), "{said}");
}

const TRAINING: [&str; 6] = ["--steps", "240", "--max-triangles", "3000", "--min-cover", "0.05"];

/// A folder with photos and a plan of three blocks, `city`.
fn planned() -> TempDir {
    let made = shared("city-planned", |folder| {
        samples::photos(folder.join("photos"), [30, 64, 800], 0);
        succeed(
            folder,
            &[&["plan", "photos", "-o", "city", "--blocks", "3"], &TRAINING[..]].concat(),
        );
    });
    copied(&made)
}

/// The same, with all blocks trained.
fn trained() -> TempDir {
    let made = shared("city-trained", |folder| {
        copy_folder(planned().path(), folder);
        for block in 0..3 {
            succeed(folder, &["train", "--block", &format!("city/manifest.json:{block}")]);
        }
    });
    copied(&made)
}

/// A copy that a test may change.
fn copied(made: &Path) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    copy_folder(made, folder.path());
    folder
}

fn bytes(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap()
}

/// Files of a folder with this ending, by name.
fn ending(folder: &Path, ending: &str) -> BTreeSet<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    entries.filter(|path| path.to_string_lossy().ends_with(ending)).collect()
}

fn blocks(city: &Path) -> Vec<PathBuf> {
    let is_block =
        |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with("block-");
    ending(city, ".ply").into_iter().filter(is_block).collect()
}

#[test]
fn one_block_is_a_plain_run() {
    let folder = planned();
    let options = ["--steps", "40", "--max-triangles", "900"];
    succeed(
        folder.path(),
        &[&["train", "photos", "-o", "plain.ply", "--teacher", "off"], &options[..]].concat(),
    );
    succeed(
        folder.path(),
        &[&["plan", "photos", "-o", "one", "--blocks", "1"], &options[..]].concat(),
    );
    succeed(folder.path(), &["train", "--block", "one:0"]);
    succeed(folder.path(), &["merge", "one", "-o", "merged.ply"]);
    assert!(bytes(folder.path(), "plain.ply") == bytes(folder.path(), "merged.ply"));
}

#[test]
fn a_plan_is_a_function_of_its_inputs() {
    let folder = planned();
    let again =
        [&["plan", "photos", "-o", "again", "--blocks", "3", "--threads", "1"], &TRAINING[..]]
            .concat();
    succeed(folder.path(), &again);
    assert!(
        bytes(folder.path(), "city/manifest.json") == bytes(folder.path(), "again/manifest.json")
    );
    let manifest: Value =
        serde_json::from_slice(&bytes(folder.path(), "city/manifest.json")).unwrap();
    let blocks = manifest["blocks"].as_array().unwrap();
    assert_eq!(blocks.len(), 3);
    for block in blocks {
        assert!(
            block["photos"].as_array().unwrap().len() >= 3 && block["steps"].as_u64().unwrap() > 0
        );
        assert!(block["frozen"].as_u64().unwrap() > 0, "the rest of the scene is drawn");
    }
    fail(folder.path(), &again, &["manifest.json", "--force"]);
}

#[test]
fn where_the_photos_lie_changes_no_block() {
    let folder = trained();
    let moved = tempfile::tempdir().unwrap();
    copy_folder(&folder.path().join("photos"), &moved.path().join("elsewhere/pictures"));
    let plan =
        [&["plan", "elsewhere/pictures", "-o", "city", "--blocks", "3"], &TRAINING[..]].concat();
    succeed(moved.path(), &plan);
    let manifest = |folder: &Path| {
        let mut manifest: Value =
            serde_json::from_slice(&bytes(folder, "city/manifest.json")).unwrap();
        (manifest["dataset"].take(), manifest)
    };
    let (here, one) = manifest(folder.path());
    let (there, other) = manifest(moved.path());
    assert_eq!((here, there), ("../photos".into(), "../elsewhere/pictures".into()));
    assert_eq!(one, other);
    // A block is the same file, wherever it was trained; what is made of all of them names its
    // photos.
    for block in 0..3 {
        succeed(moved.path(), &["train", "--block", &format!("city:{block}")]);
    }
    succeed(moved.path(), &["merge", "city", "-o", "city.ply"]);
    let files = |place: &TempDir| -> Vec<Vec<u8>> {
        blocks(&place.path().join("city")).iter().map(|path| std::fs::read(path).unwrap()).collect()
    };
    assert!(files(&folder) == files(&moved));
    let merged =
        trisplat_formats::read(&moved.path().join("city.ply"), &trisplat::ReadOptions::default())
            .unwrap();
    assert_eq!(merged.provenance.source.as_deref(), Some("pictures"));
}

#[test]
fn tasks_that_are_killed_end_with_the_same_bytes() {
    let folder = trained();
    let city = folder.path().join("city");
    let whole: Vec<(PathBuf, Vec<u8>)> = blocks(&city)
        .into_iter()
        .map(|path| (path.clone(), std::fs::read(path).unwrap()))
        .collect();
    assert_eq!(whole.len(), 3);
    let said = succeed(folder.path(), &["train", "--block", "city:1"]);
    assert!(said.contains("already exists"), "{said}");
    for (path, _) in &whole {
        std::fs::remove_file(path).unwrap();
    }
    // Stopped in good order, again and again; then killed at once. What is done goes on elsewhere,
    // on another number of threads.
    let mut stops = 0;
    loop {
        let stopped = run(
            folder.path(),
            &["train", "--block", "city:0", "--threads", "1", "--max-cpu-secs", "0.01"],
        );
        assert!(stopped.status.success(), "{}", stderr(&stopped));
        if whole[0].0.is_file() {
            break;
        }
        stops += 1;
        assert!(stops < 200 && !ending(&city, ".checkpoint").is_empty());
    }
    assert!(stops > 0);
    for (i, patience) in [(1, 5), (1, 25), (1, 60), (2, 40)] {
        let block = format!("city:{i}");
        let mut child =
            command(folder.path(), &["train", "--block", &block, "--checkpoint-every", "2"])
                .spawn()
                .unwrap();
        std::thread::sleep(std::time::Duration::from_millis(patience));
        child.kill().unwrap();
        child.wait().unwrap();
    }
    (1..3).for_each(|i| {
        drop(succeed(folder.path(), &["train", "--block", &format!("city:{i}"), "--threads", "2"]))
    });
    for (path, bytes) in &whole {
        assert!(std::fs::read(path).unwrap() == *bytes, "{}", path.display());
    }
    assert!(ending(&city, ".checkpoint").is_empty());
}

#[test]
fn a_task_reads_its_own_photos_and_no_points() {
    let folder = trained();
    let result = &blocks(&folder.path().join("city"))[1];
    let name = result.file_name().unwrap();
    let trained = std::fs::read(result).unwrap();
    let manifest: Value =
        serde_json::from_slice(&bytes(folder.path(), "city/manifest.json")).unwrap();
    let shown: Vec<&str> = manifest["blocks"][1]["photos"]
        .as_array()
        .unwrap()
        .iter()
        .map(|p| {
            manifest["photos"][p["photo"].as_u64().unwrap() as usize]["name"].as_str().unwrap()
        })
        .collect();
    let bare = planned();
    std::fs::write(bare.path().join("photos/points.ply"), "no points any more").unwrap();
    let others = ending(&bare.path().join("photos/images"), ".png");
    let others =
        others.iter().filter(|p| !shown.contains(&p.file_name().unwrap().to_str().unwrap()));
    assert!(others.map(|path| std::fs::remove_file(path).unwrap()).count() > 0);
    succeed(bare.path(), &["train", "--block", "city:1"]);
    assert!(std::fs::read(bare.path().join("city").join(name)).unwrap() == trained);
}

#[test]
fn plan_leaves_out_blocks_that_no_photo_shows() {
    let folder = planned();
    // Photos that look down on one corner of the scene only; the points are those of all of it.
    let sparse = folder.path().join("photos/sparse/0");
    let edit = |name: &str, line: &dyn Fn(usize, &str) -> String| {
        let text = std::fs::read_to_string(sparse.join(name)).unwrap();
        let edited: String =
            text.lines().enumerate().map(|(i, text)| line(i, text) + "\n").collect();
        std::fs::write(sparse.join(name), edited).unwrap();
    };
    edit("images.txt", &|i, text| match text.split(' ').collect::<Vec<_>>()[..] {
        [id, _, _, _, _, _, _, _, camera, name] if name.ends_with(".png") => {
            let turn = std::f64::consts::FRAC_1_SQRT_2;
            format!("{id} {turn} {turn} 0 0 {} -1.5 4 {camera} {name}", 1.5 + 1e-3 * i as f64)
        }
        _ if text.starts_with('#') => text.to_owned(),
        // Observations of the poses before: with them, the points would be those of another
        // reconstruction.
        _ => String::new(),
    });
    edit("cameras.txt", &|_, text| match text.split(' ').collect::<Vec<_>>()[..] {
        [id, "PINHOLE", width, height, _, _, x, y] => {
            format!("{id} PINHOLE {width} {height} 300 300 {x} {y}")
        }
        _ => text.to_owned(),
    });
    let plan = ["plan", "photos", "-o", "corner", "--blocks", "16", "--coarse-steps", "20"];
    let more = ["--set", "init.shell_subdivisions=0", "--steps", "60", "--max-triangles", "3001"];
    let said = succeed(folder.path(), &[&plan[..], &more[..]].concat());
    assert!(said.contains("of 16 blocks are left out: no photo shows them"), "{said}");
    let manifest: Value =
        serde_json::from_slice(&bytes(folder.path(), "corner/manifest.json")).unwrap();
    let blocks = manifest["blocks"].as_array().unwrap();
    assert!((1..16).contains(&blocks.len()), "{}", blocks.len());
    assert_eq!(blocks.iter().map(|b| b["core_triangles"].as_u64().unwrap()).sum::<u64>(), 3001);
}

#[test]
fn blocks_become_one_scene_and_one_tileset() {
    fail(
        planned().path(),
        &["merge", "city", "-o", "city.ply"],
        &["3 of 3 blocks", "trisplat train --block"],
    );
    let folder = trained();
    let city = folder.path().join("city");
    let status = run(folder.path(), &["plan", "--status", "city"]);
    assert!(String::from_utf8_lossy(&status.stdout).contains("3 of 3 blocks done"));
    let said = succeed(folder.path(), &["merge", "city", "-o", "city.ply"]);

    // Every triangle is owned once: as many as there are in the file, in as many places.
    let options = trisplat::ReadOptions::default();
    let scene = trisplat_formats::read(&folder.path().join("city.ply"), &options).unwrap();
    let digits: String =
        said.split(": ").nth(1).unwrap().chars().take_while(|c| *c != ' ').collect();
    assert_eq!(scene.scene.triangle_count().to_string(), digits.replace(',', ""), "{said}");
    let read =
        |path: &PathBuf| trisplat_formats::read(path, &options).unwrap().scene.triangle_count();
    let trained: usize = blocks(&city).iter().map(read).sum();
    assert!(
        scene.scene.triangle_count() < trained && scene.scene.shell_count() > 0,
        "halos are left out"
    );
    let manifest: Value =
        serde_json::from_slice(&bytes(folder.path(), "city/manifest.json")).unwrap();
    assert_eq!(scene.cameras.len(), manifest["photos"].as_array().unwrap().len());

    let tiles = ["-o", "city.tileset.json", "--set", "tile_triangles=1000", "--set", "reshape=off"];
    succeed(folder.path(), &[&["bake", "city"], &tiles[..]].concat());
    let set: Value = serde_json::from_slice(&bytes(folder.path(), "city.tileset.json")).unwrap();
    let mut uris = Vec::new();
    collect(&set["root"], f64::INFINITY, &mut uris);
    let there: BTreeSet<PathBuf> = ending(&folder.path().join("city.tiles"), ".glb");
    assert_eq!(uris.iter().map(|uri| folder.path().join(uri)).collect::<BTreeSet<_>>(), there);
    for index in 0..3 {
        assert!(uris.iter().any(|uri| uri.contains(&format!("/b{index}r-"))), "{uris:?}");
    }
    fail(folder.path(), &["bake", "city", "-o", "city.glb"], &[".tileset.json", "merge"]);
    assert_eq!(blocks(&city).len(), 3);
}

/// The files of a tile and those below it, whose errors never grow.
fn collect(tile: &Value, above: f64, uris: &mut Vec<String>) {
    let error = tile["geometricError"].as_f64().unwrap();
    assert!(error <= above);
    uris.extend(tile["content"]["uri"].as_str().map(str::to_owned));
    tile["children"].as_array().into_iter().flatten().for_each(|child| collect(child, error, uris));
}

#[test]
fn what_is_not_as_it_was_planned_is_refused() {
    let folder = planned();
    fail(folder.path(), &["train", "--block", "city:3"], &["block is 3", "0 to 2"]);
    let manifest: Value =
        serde_json::from_slice(&bytes(folder.path(), "city/manifest.json")).unwrap();
    let most = manifest["blocks"]
        .as_array()
        .unwrap()
        .iter()
        .map(|b| b["expected"]["bytes"].as_u64().unwrap());
    let memory = format!("{}B", most.max().unwrap() - 1);
    let small =
        [&["plan", "photos", "-o", "small", "--blocks", "3", "--memory", &memory], &TRAINING[..]]
            .concat();
    fail(folder.path(), &small, &["what block ", "is expected to take", "--blocks"]);
    assert!(!folder.path().join("small/manifest.json").exists());
    // What no photo could change is refused before any is looked for.
    let blind = ["plan", "nowhere", "-o", "blind", "--blocks", "3", "--memory", "1MB"];
    fail(folder.path(), &blind, &["the largest block, even without photos,", "--blocks"]);
    assert!(!folder.path().join("blind").exists());

    let files =
        std::fs::read_dir(folder.path().join("city")).unwrap().map(|entry| entry.unwrap().path());
    let is_start = |path: &std::path::PathBuf| {
        path.file_name().unwrap().to_str().is_some_and(|name| name.starts_with("start-0001-"))
    };
    let start = files.into_iter().find(is_start).unwrap();
    let kept = std::fs::read(&start).unwrap();
    let mut other = kept.clone();
    *other.last_mut().unwrap() ^= 1;
    std::fs::write(&start, other).unwrap();
    fail(
        folder.path(),
        &["train", "--block", "city:1"],
        &["start-0001-", "has changed since it was planned"],
    );
    std::fs::write(&start, kept).unwrap();

    let manifest = folder.path().join("city/manifest.json");
    let text = std::fs::read_to_string(&manifest).unwrap();
    let steps: Value = serde_json::from_str(&text).unwrap();
    let steps = steps["blocks"][1]["steps"].as_u64().unwrap();
    let line = |steps: u64| format!("\"steps\": {steps},\n      \"first_step");
    let was = line(steps);
    assert!(text.contains(&was));
    std::fs::write(&manifest, text.replace(&was, &line(steps + 1))).unwrap();
    fail(folder.path(), &["train", "--block", "city:1"], &["was changed by hand"]);
    std::fs::write(&manifest, &text).unwrap();

    for photo in ending(&folder.path().join("photos/images"), ".png") {
        let mut pixels = trisplat_scene::image::RgbImage::load(&photo).unwrap();
        pixels.rgb[0][0] ^= 1;
        pixels.save_png(&photo).unwrap();
    }
    fail(
        folder.path(),
        &["train", "--block", "city:1"],
        &["photo `", "its file has changed since it was planned"],
    );
    assert!(blocks(&folder.path().join("city")).is_empty());
}
