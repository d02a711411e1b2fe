//! The command line as a user meets it: exit codes, messages, layers, files.

mod budget;
mod capture;
#[cfg(feature = "gpu")]
mod card;
mod checkpoints;
mod city;
mod collision;
mod damaged;
mod examples;
mod fidelity;
mod foreign_names;
mod guards;
mod info;
mod inputs;
mod install;
mod library;
mod make;
mod max_bytes;
mod messages;
mod option_ranges;
#[cfg(target_os = "linux")]
mod out_of_memory;
mod outputs;
mod pages;
mod python;
mod readme;
mod resources;
mod samples;
mod schemas;
mod splats;
mod splats_bake;
mod stops;
mod textures;
mod train;
mod train_teacher;
mod user_files;
mod words;

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups").join(name)
}

fn trisplat(arguments: &[&dyn AsRef<std::ffi::OsStr>]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.args(arguments.iter().map(|a| a.as_ref()));
    let has = |word: &str| arguments.iter().any(|a| a.as_ref() == word);
    if arguments[0].as_ref() == "bake" && !has("--preset") {
        // It takes long and is tested where it belongs; here only what is said and written matters.
        command.args(["--set", "reshape=off"]);
    }
    command.stdin(Stdio::null()).output().unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// Runs, wants exit code 1, one line of error that holds all of `needles`, and no new file in
/// `folder`.
fn fails(folder: &Path, arguments: &[&dyn AsRef<std::ffi::OsStr>], needles: &[&str]) {
    let before = std::fs::read_dir(folder).unwrap().count();
    let output = trisplat(arguments);
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(1), "{text}");
    let errors: Vec<&str> = text.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{text}");
    for needle in needles {
        assert!(errors[0].contains(needle), "{:?} lacks {needle:?}", errors[0]);
    }
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), before, "something was left behind");
}

#[test]
fn bake_writes_a_glb_and_prints_the_stage_table() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.glb");
    let output = trisplat(&[&"bake", &sample("studio.ply"), &"-o", &out, &"-v"]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert_eq!(&std::fs::read(&out).unwrap()[..4], b"glTF");
    for stage in ["prune", "solid", "color", "weld", "place", "chunk", "order", "write"] {
        assert!(
            stderr(&output).lines().any(|l| l.starts_with(stage)),
            "{stage}: {}",
            stderr(&output)
        );
    }
    assert!(output.stdout.is_empty());
}

#[test]
fn quiet_prints_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let output =
        trisplat(&[&"bake", &"-q", &sample("studio.ply"), &"-o", &folder.path().join("a.glb")]);
    assert!(output.status.success() && output.stderr.is_empty() && output.stdout.is_empty());
}

#[test]
fn an_existing_file_needs_force() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.glb");
    std::fs::write(&out, b"precious").unwrap();
    fails(folder.path(), &[&"bake", &sample("studio.ply"), &"-o", &out], &["scene.glb", "--force"]);
    assert_eq!(std::fs::read(&out).unwrap(), b"precious");
    assert!(trisplat(&[&"bake", &"-f", &sample("studio.ply"), &"-o", &out]).status.success());
    assert_eq!(&std::fs::read(&out).unwrap()[..4], b"glTF");
}

#[test]
fn levels_of_detail_are_written_together_or_not_at_all() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.glb");
    let report = folder.path().join("report.json");
    let lod2 = folder.path().join("scene.lod2.glb");
    std::fs::write(&lod2, b"precious").unwrap();
    let levels: [&dyn AsRef<std::ffi::OsStr>; 6] =
        [&"bake", &sample("studio.ply"), &"-o", &out, &"--lod", &"0.5,0.25"];
    fails(folder.path(), &levels, &["scene.lod2.glb", "--force"]);
    std::fs::remove_file(&lod2).unwrap();
    let output = trisplat(&[&levels[..], &[&"--report", &report]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let names = ["scene.glb", "scene.lod1.glb", "scene.lod2.glb", "scene.tileset.json"];
    for (name, output) in names.iter().zip(report["outputs"].as_array().unwrap()) {
        let bytes = std::fs::metadata(folder.path().join(name)).unwrap().len();
        assert!(
            output["path"].as_str().unwrap().ends_with(name) && output["bytes"] == bytes,
            "{output}"
        );
    }
    let set = std::fs::read(folder.path().join("scene.tileset.json")).unwrap();
    let set: serde_json::Value = serde_json::from_slice(&set).unwrap();
    let mut tile = &set["root"];
    for name in names[..3].iter().rev() {
        assert_eq!(tile["content"]["uri"], **name);
        let finer = &tile["children"][0];
        assert!(
            finer.is_null() || finer["geometricError"].as_f64() <= tile["geometricError"].as_f64()
        );
        tile = finer;
    }
    fails(
        folder.path(),
        &[&"bake", &sample("studio.ply"), &"-o", &"-", &"--lod", &"0.5"],
        &["--lod", "file"],
    );
    let rising = [
        &"bake" as &dyn AsRef<std::ffi::OsStr>,
        &sample("studio.ply"),
        &"-o",
        &lod2,
        &"--lod",
        &"0.2,0.5",
    ];
    fails(folder.path(), &rising, &["--lod", "fall"]);
}

/// Names in a folder, sorted.
fn names_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// The files that a tile and those below it name, relative to the tileset.
fn uris(tile: &serde_json::Value, out: &mut Vec<String>) {
    out.extend(tile["content"]["uri"].as_str().map(str::to_owned));
    tile["children"].as_array().into_iter().flatten().for_each(|child| uris(child, out));
}

#[test]
fn a_tileset_names_the_tiles_there_are_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.tileset.json");
    let bake = |args: &[&dyn AsRef<std::ffi::OsStr>]| {
        let all: [&dyn AsRef<std::ffi::OsStr>; 6] =
            [&"bake", &sample("studio.ply"), &"-o", &out, &"--preset", &"fast"];
        let output = trisplat(&[&all[..], args].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        let set: serde_json::Value = serde_json::from_slice(&std::fs::read(&out).unwrap()).unwrap();
        let mut named = Vec::new();
        uris(&set["root"], &mut named);
        let mut there: Vec<String> = names_in(&folder.path().join("scene.tiles"))
            .iter()
            .map(|n| format!("scene.tiles/{n}"))
            .collect();
        there.retain(|name| !name.ends_with("notes.txt"));
        named.sort();
        assert_eq!(named, there);
        named
    };
    let coarse = bake(&[&"--set", &"tile_triangles=2000"]);
    assert!(coarse.len() > 4, "{coarse:?}");
    // What is not ours stays, tiles of before go, and equal tiles keep their names.
    std::fs::write(folder.path().join("scene.tiles/notes.txt"), b"mine").unwrap();
    let fine = bake(&[&"--set", &"tile_triangles=1000", &"-f"]);
    assert!(fine.len() > coarse.len());
    assert_eq!(std::fs::read(folder.path().join("scene.tiles/notes.txt")).unwrap(), b"mine");
    assert_eq!(bake(&[&"--set", &"tile_triangles=1000", &"-f", &"--set", &"tiles=true"]), fine);
    for name in &fine {
        assert_eq!(&std::fs::read(folder.path().join(name)).unwrap()[..4], b"glTF", "{name}");
    }
}

#[test]
fn tiles_go_into_a_tileset_only() {
    let folder = tempfile::tempdir().unwrap();
    let glb = folder.path().join("a.glb");
    let set = folder.path().join("a.tileset.json");
    fails(
        folder.path(),
        &[&"bake", &sample("studio.ply"), &"-o", &glb, &"--set", &"tiles=true"],
        &[".tileset.json"],
    );
    fails(
        folder.path(),
        &[&"bake", &sample("studio.ply"), &"-o", &set, &"--lod", &"0.5"],
        &["--lod"],
    );
    let json = folder.path().join("a.json");
    fails(folder.path(), &[&"bake", &sample("studio.ply"), &"-o", &json], &[".tileset.json"]);
    assert!(names_in(folder.path()).is_empty());
    let dry = trisplat(&[&"bake", &sample("studio.ply"), &"-o", &set, &"--dry-run"]);
    assert!(dry.status.success() && names_in(folder.path()).is_empty(), "{}", stderr(&dry));
}

#[test]
fn an_input_is_never_overwritten() {
    let folder = tempfile::tempdir().unwrap();
    let both = folder.path().join("scene.ply");
    std::fs::copy(sample("studio.ply"), &both).unwrap();
    let bytes = std::fs::read(&both).unwrap();
    fails(folder.path(), &[&"bake", &"--force", &both, &"-o", &both], &["also an input"]);
    assert_eq!(std::fs::read(&both).unwrap(), bytes);
}

#[test]
fn a_dry_run_writes_nothing_and_says_how_much_it_would() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.glb");
    let output = trisplat(&[&"bake", &"--dry-run", &sample("studio.ply"), &"-o", &out]);
    assert!(output.status.success());
    assert!(stderr(&output).contains("would write"), "{}", stderr(&output));
    assert!(!out.exists());
}

#[test]
fn standard_input_and_output_carry_files() {
    let soup = std::fs::read(sample("studio.ply")).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_trisplat"))
        .args(["bake", "-", "-o", "-"])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(&soup).unwrap();
    let piped = child.wait_with_output().unwrap();
    assert!(piped.status.success(), "{}", stderr(&piped));
    assert_eq!(&piped.stdout[..4], b"glTF");
    assert!(stderr(&piped).contains("prune"), "logs belong on stderr");
}

#[test]
fn several_inputs_merge() {
    let folder = tempfile::tempdir().unwrap();
    let report = folder.path().join("report.json");
    let count = |inputs: &[PathBuf]| {
        let mut arguments: Vec<&dyn AsRef<std::ffi::OsStr>> =
            vec![&"bake", &"-q", &"-f", &"--dry-run"];
        inputs.iter().for_each(|i| arguments.push(i));
        arguments.extend([&"-o" as &dyn AsRef<_>, &"scene.glb", &"--report", &report]);
        assert!(trisplat(&arguments).status.success());
        let text = std::fs::read_to_string(&report).unwrap();
        let value: serde_json::Value = serde_json::from_str(&text).unwrap();
        value["stages"][1]["before"]["triangles"].as_u64().unwrap()
    };
    let one = count(&[sample("studio.ply")]);
    assert_eq!(count(&[sample("studio.ply"), sample("studio.ply")]), 2 * one);
}

#[test]
fn the_same_bytes_for_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    let bake = |threads: &str, name: &str| {
        let out = folder.path().join(name);
        let output = trisplat(&[
            &"bake",
            &sample("studio.ply"),
            &"-o",
            &out,
            &"--set",
            &"chunk_triangles=500",
            &"--threads",
            &threads,
        ]);
        assert!(output.status.success(), "{}", stderr(&output));
        std::fs::read(&out).unwrap()
    };
    let one = bake("1", "one.glb");
    assert!(one == bake("2", "two.glb"));
    assert!(one == bake("5", "five.glb"));
}

#[test]
fn layers_go_preset_config_flags() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("bake.json");
    std::fs::write(
        &config,
        r#"{ "preset": "small", "backdrop": { "backdrop": "off" }, "prune": { "min_opacity": 0.3, "max_sigma": 2.5 } }"#,
    )
    .unwrap();
    let report = folder.path().join("report.json");
    // --backdrop is typed with its very default: it must win over the config file all the same.
    let output = trisplat(&[
        &"bake",
        &"--dry-run",
        &sample("studio.ply"),
        &"-o",
        &"s.glb",
        &"--config",
        &config,
        &"--set",
        &"min_opacity=0.014",
        &"--backdrop",
        &"auto",
        &"--report",
        &report,
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let value: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    assert_eq!(value["options"]["prune"]["min_opacity"], 0.014, "setting over config");
    assert_eq!(value["options"]["backdrop"]["backdrop"], "auto", "flag over config");
    assert_eq!(value["options"]["prune"]["max_sigma"], 2.5, "config over preset");
    assert_eq!(value["options"]["output"]["compress"], true, "preset over default");
}

#[test]
fn the_config_of_the_samples_is_taken_with_its_schema() {
    let folder = tempfile::tempdir().unwrap();
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/bake.json");
    let report = folder.path().join("report.json");
    let bake = [
        &"bake" as &dyn AsRef<std::ffi::OsStr>,
        &"--dry-run",
        &sample("studio.ply"),
        &"-o",
        &"s.glb",
    ];
    let output = trisplat(&[&bake[..], &[&"--config", &config, &"--report", &report]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    let value: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    assert_eq!(value["options"]["prune"]["max_triangles"], 2_000_000);
    assert_eq!(value["options"]["output"]["target"], "godot");
}

#[test]
fn a_misspelt_key_names_the_right_ones() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("bake.json");
    std::fs::write(&config, "{\n  \"prune\": { \"min_opacty\": 0.3 }\n}").unwrap();
    fails(
        folder.path(),
        &[
            &"bake",
            &sample("studio.ply"),
            &"-o",
            &folder.path().join("s.glb"),
            &"--config",
            &config,
        ],
        &["bake.json", "line 2", "min_opacty", "`min_opacity`"],
    );
}

#[test]
fn an_unknown_flag_suggests_the_near_one() {
    let output = trisplat(&[&"bake", &"a.ply", &"-o", &"b.glb", &"--max-triangle", &"5"]);
    assert_eq!(output.status.code(), Some(2));
    assert!(stderr(&output).contains("--max-triangles"), "{}", stderr(&output));
}

#[test]
fn bad_arguments_fail_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("s.glb");
    let soup = sample("studio.ply");
    let odd = folder.path().join("s.fbx");
    fails(folder.path(), &[&"bake", &soup, &"-o", &odd], &["s.fbx", ".glb", "--format"]);
    fails(
        folder.path(),
        &[&"bake", &soup, &"-o", &out, &"--set", &"scale=0"],
        &["scale is 0", "expected 0.000000001 or more"],
    );
    fails(
        folder.path(),
        &[&"bake", &soup, &"-o", &out, &"--set", &"scale=nan"],
        &["--set", "a number"],
    );
    let obj = [&"bake" as &dyn AsRef<std::ffi::OsStr>, &soup, &"-o", &"-", &"--format", &"obj"];
    fails(folder.path(), &obj, &["second file"]);
    fails(folder.path(), &[&"bake", &folder.path(), &"-o", &out], &["is a folder"]);
    fails(folder.path(), &[&"bake", &folder.path().join("no.ply"), &"-o", &out], &["no.ply"]);
    fails(
        folder.path(),
        &[&"bake", &soup, &"-o", &folder.path().join("no/where.glb")],
        &["where.glb"],
    );
    fails(
        folder.path(),
        &[&"bake", &soup, &"-o", &out, &"--set", &"min_opacity=2"],
        &["min_opacity is 2"],
    );
    let nowhere = "90,90,90,91,91,91";
    fails(folder.path(), &[&"bake", &soup, &"-o", &out, &"--crop", &nowhere], &["--crop"]);
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_one_error() {
    let folder = tempfile::tempdir().unwrap();
    fails(
        folder.path(),
        &[&"bake", &sample("studio.ply"), &"-o", &"/dev/full"],
        &["/dev/full", "space"],
    );
}

#[test]
fn completions_and_schemas_print() {
    for shell in ["bash", "zsh", "fish"] {
        assert!(
            String::from_utf8_lossy(&trisplat(&[&"completions", &shell]).stdout)
                .contains("trisplat")
        );
    }
    assert!(
        String::from_utf8_lossy(&trisplat(&[&"schema", &"bake"]).stdout).contains("min_opacity")
    );
}
