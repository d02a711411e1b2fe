//! The program as WebAssembly, in Node and in a browser's page: the bytes of the program, its
//! words, and nothing of the network.

use super::browser::{assert_seen, chromium, mesh, named};
use super::{have, here, runs, runs_with, small_studio, studio};
use checkpoints::{checkpoint, floats};
use serde_json::{Value, json};
use std::fs;
use std::ops::ControlFlow::Continue;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;
use trisplat::{BakeJob, BakeOptions};
use trisplat_fixtures::checkpoints;
use trisplat_job::BakeInput;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::lanes::{SimdLevel, with_at_most};
use trisplat_scene::math::metric;

/// Whether `web/build.sh` has built the package and the page.
fn built() -> bool {
    have(
        "web",
        here("target/web/npm/trisplat.wasm").exists() && here("target/web/app/index.html").exists(),
    )
}

/// The lines of a script, one for each of `asked`.
fn lines(command: &mut Command, asked: &Value) -> Vec<Value> {
    let done = runs_with(command, asked.to_string().as_bytes());
    let lines: Vec<Value> = done
        .stdout
        .split(|&b| b == b'\n')
        .filter_map(|line| serde_json::from_slice(line).ok())
        .collect();
    assert_eq!(
        lines.len(),
        asked.as_array().unwrap().len(),
        "{}",
        String::from_utf8_lossy(&done.stderr)
    );
    lines
}

fn in_node(jobs: &Value) -> Vec<Value> {
    lines(Command::new("node").arg(here("tests/judges/web.mjs")).arg(here("target/web/npm")), jobs)
}

fn in_page(chromium: &Path, visits: &Value) -> Vec<Value> {
    let mut command = Command::new("node");
    command.arg(here("tests/judges/app.mjs")).arg(here("target/judges")).arg(chromium);
    lines(command.arg(here("target/web/app/index.html")), visits)
}

/// What the program says, or the files that it wrote.
fn program(folder: &Path, arguments: &[&str]) -> Result<(), String> {
    let done = Command::new(env!("CARGO_BIN_EXE_trisplat"))
        .args(arguments)
        .current_dir(folder)
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&done.stderr).into_owned();
    if done.status.success() { Ok(()) } else { Err(said) }
}

/// Asserts that both folders have these files, and the same bytes in each.
fn assert_same(folder: &Path, other: &Path, names: &Value) {
    let names: Vec<&str> =
        names.as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect();
    assert!(!names.is_empty());
    for name in names {
        let [ours, theirs] = [folder, other].map(|folder| fs::read(folder.join(name)).unwrap());
        assert!(ours == theirs, "{name}: {} and {} bytes", ours.len(), theirs.len());
    }
}

/// The photo among the files that are no scenes.
const PHOTO: &str = "photo.jpg";

/// Files that no reader should take, or that lose something: their names, and their bytes.
fn hostile() -> Vec<(&'static str, Vec<u8>)> {
    let ply = fs::read(studio()).unwrap();
    let zip = [b"PK\x03\x04".as_slice(), &[0; 60]].concat();
    let huge =
        b"ply\nformat binary_little_endian 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n";
    vec![
        ("empty.ply", Vec::new()),
        ("cut.ply", ply[..ply.len() / 2].to_vec()),
        ("head.ply", ply[..40].to_vec()),
        ("huge.ply", huge.to_vec()),
        ("zip.pt", zip),
        ("old.pt", b"\x80\x02}q\x00.".to_vec()),
        ("short.glb", b"glTF\x02\x00\x00\x00\xff\xff\xff\xff".to_vec()),
        ("deep.gltf", [b"{\"a\":".as_slice(), &b"[".repeat(100_000)].concat()),
        ("far.obj", b"v 0 0 0\nv 1 0 0\nf 1 2 9\n".to_vec()),
        ("nan.obj", b"v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".to_vec()),
        ("words.txt", b"hello world".to_vec()),
        ("other.html", b"<!doctype html><p>no scene".to_vec()),
        (PHOTO, b"\xff\xd8\xff\xe0\0\x10JFIF\0\x01\x01".to_vec()),
    ]
}

#[test]
fn node_writes_the_bytes_of_the_program() {
    if !built() {
        return;
    }
    let [ours, theirs] = [(); 2].map(|()| TempDir::new().unwrap());
    let cube = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nf 1 2 3 4\nf 1 2 5\n";
    fs::write(ours.path().join("cube.obj"), cube).unwrap();
    for name in ["studio.ply", "trained.ply", "degenerate.ply"] {
        fs::copy(here("samples/soups").join(name), ours.path().join(name)).unwrap();
    }
    // A GLB to read is one that was written.
    let first = ["bake", "trained.ply", "-o", "first.glb", "--preset", "small", "--target", "web"];
    program(ours.path(), &first).unwrap();
    let cases: [(&str, &str, Value, &[&str]); 9] = [
        ("trained.ply", "a.glb", json!({}), &[]),
        ("trained.ply", "b.gltf", json!({ "target": "godot" }), &["--target", "godot"]),
        (
            "trained.ply",
            "c.glb",
            json!({ "preset": "small", "target": "web" }),
            &["--preset", "small", "--target", "web"],
        ),
        (
            "trained.ply",
            "d.glb",
            json!({ "max_triangles": 1000, "up": "y" }),
            &["--max-triangles", "1000", "--up", "y"],
        ),
        (
            "trained.ply",
            "e.glb",
            json!({ "crop": ["-1,-1,-1,1,1,1"] }),
            &["--crop", "-1,-1,-1,1,1,1"],
        ),
        ("degenerate.ply", "f.ply", json!({ "teacher": "off" }), &["--teacher", "off"]),
        ("cube.obj", "g.obj", json!({}), &[]),
        ("first.glb", "h.html", json!({}), &[]),
        (
            "studio.ply",
            "i.glb",
            json!({ "teacher": "off", "lod": [0.5], "chunk_triangles": 1000 }),
            &["--teacher", "off", "--lod", "0.5", "--set", "chunk_triangles=1000"],
        ),
    ];
    let job = |(input, output, options, _): &(&str, &str, Value, &[&str])| {
        let files = json!({ *input: ours.path().join(input) });
        let threads = if *output == "a.glb" { 2 } else { 1 };
        json!({ "files": files, "options": options, "output": output, "folder": theirs.path(), "threads": threads,
                "unshared": *output == "c.glb" })
    };
    let done = in_node(&cases.iter().map(job).collect());
    for ((input, output, _, flags), done) in cases.iter().zip(done) {
        program(ours.path(), &[&["bake", input, "-o", output], *flags].concat()).unwrap();
        assert!(done["error"].is_null(), "{output}: {done}");
        assert_same(ours.path(), theirs.path(), &done["names"]);
        assert!(
            done["names"].as_array().unwrap().contains(&json!(output))
                && done["stages"] != json!([])
        );
    }
}

/// With a program that writes two files of its output's name.
#[test]
fn an_output_is_returned_under_the_name_that_was_given() {
    if !have("node", Command::new("node").arg("--version").output().is_ok()) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    for file in fs::read_dir(here("web/src")).unwrap().map(|file| file.unwrap().path()) {
        fs::copy(&file, at(file.file_name().unwrap().to_str().unwrap())).unwrap();
    }
    fs::write(at("package.json"), r#"{"type": "module"}"#).unwrap();
    fs::write(at("trisplat.wasm"), b"\0asm\x01\0\0\0").unwrap();
    let run = "export const run = async (m, w, { output }) => ({ files: { [output]: Uint8Array.of(1), [`${output}.bin`]: Uint8Array.of(2) } });";
    fs::write(at("run.js"), run).unwrap();
    let names = ["/out/x.gltf", "./x.gltf", "../x.gltf", "a/b.c/x.gltf", "x.gltf"];
    let script = format!(
        "import {{ bake, bakeFiles }} from './index.js'; import {{ Files }} from './files.js';
        for (const output of {names:?}) {{
          const {{ files }} = await bakeFiles(new Uint8Array(1), {{}}, {{ output }});
          const bytes = await bake(new Uint8Array(1), {{}}, {{ output }});
          console.log(JSON.stringify([Object.keys(files), bytes.length]));
        }}
        const given = new Files({{ './a.ply': new Uint8Array(1), '/b/../c.ply': new Uint8Array(1) }});
        console.log(JSON.stringify([given.get('a.ply')?.size, given.get('c.ply')?.size]));"
    );
    fs::write(at("test.mjs"), script).unwrap();
    let done = runs(Command::new("node").arg(at("test.mjs")));
    let mut wanted = names.map(|name| json!([[name, format!("{name}.bin")], 1])).to_vec();
    wanted.push(json!([1, 1]));
    let said = String::from_utf8_lossy(&done.stdout);
    let said: Vec<Value> = said.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(said, wanted);
}

#[test]
fn a_checkpoint_becomes_the_programs_glb() {
    if !built() {
        return;
    }
    let [ours, theirs] = [(); 2].map(|()| TempDir::new().unwrap());
    let corners = (0..20u16).flat_map(|i| {
        let x = f32::from(i);
        [[x, 0.0, 0.0], [x + 1.0, 0.0, 0.0], [x, -1.0, 0.0]].concat()
    });
    let tensors = [
        floats("triangles_points", &[20, 3, 3], corners),
        floats("sigma", &[20, 1], [-3.0; 20]),
        floats("opacity", &[20, 1], [4.0; 20]),
        floats("features_dc", &[20, 1, 3], [0.5; 60]),
        floats("features_rest", &[20, 0, 3], []),
    ];
    let checkpoint_file = ours.path().join("scene.pt");
    fs::write(&checkpoint_file, checkpoint(&tensors, b"")).unwrap();
    let files = json!({ "scene.pt": checkpoint_file });
    let options = json!({ "teacher": "off" });
    let job =
        json!([{ "files": files, "options": options, "output": "a.glb", "folder": theirs.path() }]);
    let done = in_node(&job);
    assert!(done[0]["error"].is_null(), "{}", done[0]);
    program(ours.path(), &["bake", "scene.pt", "-o", "a.glb", "--teacher", "off"]).unwrap();
    assert_same(ours.path(), theirs.path(), &done[0]["names"]);
}

#[test]
fn a_soft_scene_is_fitted_as_a_cpu_without_vectors_does() {
    if !built() {
        return;
    }
    let [ours, theirs] = [(); 2].map(|()| TempDir::new().unwrap());
    let scene = studio();
    let options = json!({ "teacher_pictures": 4, "reshape_rounds": 1, "refit_passes": 1 });
    let files = json!({ "studio.ply": scene });
    let done = in_node(
        &json!([{ "files": files, "options": options, "output": "a.glb", "folder": theirs.path() }]),
    );
    assert!(done[0]["error"].is_null(), "{}", done[0]);
    let named = trisplat_scene::layered::Layers::default()
        .with_named_options(options.as_object().unwrap().clone());
    let options = named.resolve(BakeOptions::preset).unwrap().options;
    let job = BakeJob::new([BakeInput::File(scene)], options);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let output = ours.path().join("a.glb");
    let save = || with_at_most(SimdLevel::Portable, || job.save(&output, &mut |_| Continue(())));
    pool.install(save).unwrap();
    assert_same(ours.path(), theirs.path(), &done[0]["names"]);
}

#[test]
fn node_refuses_what_the_program_refuses_in_the_same_words() {
    if !built() {
        return;
    }
    let folder = TempDir::new().unwrap();
    let mut jobs = Vec::new();
    for (name, bytes) in hostile() {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        jobs.push(json!({ "files": { name: path }, "options": { "teacher": "off" }, "output": "out.glb", "folder": folder.path() }));
    }
    for ((name, _), done) in hostile().iter().zip(in_node(&jobs.into())) {
        let error = program(folder.path(), &["bake", name, "-o", "out.glb", "--teacher", "off"])
            .unwrap_err();
        let error = error.trim().strip_prefix("error: ").unwrap_or(&error).trim();
        assert_eq!(done["error"], json!(error));
    }
    let files = json!({ "studio.ply": studio() });
    let done = in_node(&json!([
        { "files": files, "options": { "max_triangels": 3 }, "output": "a.glb", "folder": folder.path() },
        { "files": files, "output": "a.xyz", "folder": folder.path() },
        { "files": files, "output": "a.glb", "folder": folder.path(), "cancel": "prune" },
        { "files": files, "info": true },
    ]));
    let error = |i: usize| done[i]["error"].as_str().unwrap_or_default().to_owned();
    assert!(
        error(0).contains("max_triangels") && error(0).contains("the name of an option"),
        "{}",
        done[0]
    );
    assert!(error(1).contains("a.xyz") && error(1).contains(".glb"), "{}", done[1]);
    assert_eq!(error(2), "cancelled");
    assert_eq!(done[3]["info"]["kind"], "soup");
}

/// The input that chooses how a scene is shown.
fn look(name: &str) -> Value {
    json!({ "check": format!("input[name=look][value={name}]") })
}

#[test]
fn the_page_bakes_what_the_program_does() {
    let Some(chromium) = chromium().filter(|_| built()) else { return };
    let [ours, theirs, isolated] = [(); 3].map(|()| TempDir::new().unwrap());
    let keep = |name: &str| {
        std::env::var_os("TRISPLAT_KEEP").map(|folder| PathBuf::from(folder).join(name))
    };
    // Small pictures, as software draws them.
    let size = [680, 300];
    let trained = here("samples/soups/trained.ply");
    // Moved while it worked, the scene is drawn soft afterwards.
    let cancelled = [(look("solid"), true)];
    fs::copy(&trained, ours.path().join("trained.ply")).unwrap();
    let visits = json!([
        { "files": [trained], "bake": true, "folder": theirs.path(), "screenshot": keep("app-bake.png"), "size": size,
          "set": { "target": "godot", "triangles": "1000", "axis": "y", "crop": true } },
        { "files": [trained], "bake": true, "folder": isolated.path(), "isolated": true, "size": size,
          "set": { "target": "godot", "triangles": "1000", "axis": "y", "crop": true } },
        { "files": [studio()], "inputs": [{ "click": "fold" }, look("soft")], "screenshot": keep("app-soft.png"), "size": [420, 800] },
        { "files": [studio()], "bake": true, "size": size, "cancel": { "wheel": -100, "notches": 5, "at": [520, 150] }, "folder": theirs.path(),
          "inputs": [look("soft")], "after": named(theirs.path(), &cancelled) },
        { "webgl": false },
    ]);
    let seen = in_page(&chromium, &visits);
    for one in &seen {
        assert_eq!(one["errors"], json!([]), "{one}");
        println!("first seen after {} ms, longest pause {} ms", one["paint"], one["pause"]);
        assert!(one["pause"].as_f64().unwrap() < 5000.0, "the page hangs: {one}");
    }
    let flags = [
        "--target",
        "godot",
        "--max-triangles",
        "1000",
        "--up",
        "y",
        "--crop=-1e9,-1e9,-1e9,1e9,1e9,1e9",
    ];
    program(ours.path(), &[&["bake", "trained.ply", "-o", "trained.glb"], &flags[..]].concat())
        .unwrap();
    assert_eq!(
        (&seen[0]["state"], &seen[0]["compares"]),
        (&json!("ready"), &json!(true)),
        "{}",
        seen[0]
    );
    assert_same(ours.path(), theirs.path(), &seen[0]["downloads"]);
    assert_eq!(
        (&seen[0]["isolated"], &seen[1]["isolated"]),
        (&json!(false), &json!(true)),
        "threads"
    );
    assert_same(ours.path(), isolated.path(), &seen[1]["downloads"]);
    assert_eq!(
        seen[0]["downloads"].as_array().unwrap().len(),
        2,
        "the GLB, and what Godot wants beside it"
    );
    assert_eq!(
        (&seen[2]["state"], &seen[2]["message"]),
        (&json!("ready"), &json!("")),
        "{}",
        seen[2]
    );
    assert_eq!(
        (&seen[3]["what"], &seen[3]["downloads"]),
        (&json!("cancelled"), &json!([])),
        "{}",
        seen[3]
    );
    assert_seen(theirs.path(), &cancelled);
    let message = seen[4]["message"].as_str().unwrap();
    assert!(seen[4]["state"] == "failed" && message.contains("WebGL 2"), "{}", seen[4]);
}

#[test]
fn the_page_draws_what_every_input_shows_at_once() {
    let Some(chromium) = chromium().filter(|_| built()) else { return };
    let [mouse, fingers] = [(); 2].map(|()| TempDir::new().unwrap());
    let scene = small_studio(mouse.path());
    // Small pictures, as software draws every frame of a glide.
    let [size, middle] = [[660, 280], [512, 140]];
    let inputs = [
        (json!({ "wheel": -100, "notches": 9, "at": middle }), true),
        (json!({ "wheel": 100, "notches": 4, "at": middle }), true),
        (json!({ "drag": [512, 140, 28, 10] }), true),
        (json!({ "drag": [512, 140, 19, 14], "button": "right" }), true),
        (json!({ "press": "w", "ms": 300 }), true),
        (json!({ "press": "ArrowLeft", "ms": 300 }), true),
        (json!({ "press": "q", "ms": 200 }), true),
        (json!({ "press": "d", "ms": 200 }), true),
        (json!({ "double": [497, 154] }), true),
        (json!({ "hide": true }), false),
        (json!({ "resize": [720, 280] }), true),
    ];
    // As the panel is folded, a phone's picture is higher than half of it.
    let touches = [
        (json!({ "pinch": [140, 180, 44, 144] }), true),
        (json!({ "finger": [140, 180, 36, 0] }), true),
        (json!({ "fingers": [140, 180, 28, 22], "least": 0.4 }), true),
        (json!({ "tap": [108, 202] }), true),
        (json!({ "click": "fold" }), true),
    ];
    let visits = json!([
        { "files": [scene], "inputs": named(mouse.path(), &inputs), "size": size },
        { "files": [scene], "inputs": named(fingers.path(), &touches), "touch": true, "size": [280, 500] },
    ]);
    for one in in_page(&chromium, &visits) {
        assert_eq!((&one["errors"], &one["state"]), (&json!([]), &json!("ready")), "{one}");
    }
    assert_seen(mouse.path(), &inputs);
    assert_seen(fingers.path(), &touches);
}

#[test]
fn every_look_changes_the_picture_at_once() {
    let Some(chromium) = chromium().filter(|_| built()) else { return };
    let [before, after] = [(); 2].map(|()| TempDir::new().unwrap());
    // A small picture, because one thread draws the soft one.
    let small = json!({ "resize": [660, 300] });
    let looks = [
        (look("wires"), true),
        (look("solid"), true),
        (json!({ "check": "#crop", "least": 0.005 }), true),
        (json!({ "range": "x0", "to": 0.4, "least": 0.005 }), true),
        (json!({ "check": "#crop", "on": false, "least": 0.005 }), true),
        (look("soft"), true),
        // Its box is seen before the solid scene.
        (json!({ "check": "#crop" }), true),
        (json!({ "check": "#crop", "on": false }), true),
        (json!({ "select": ["axis", "x"] }), true),
        (json!({ "select": ["axis", "auto"] }), true),
    ];
    let sides = [
        (json!({ "range": "split", "to": 0.2 }), true),
        (look("solid"), true),
        (json!({ "range": "split", "to": 0.8 }), true),
    ];
    let inputs =
        [vec![small.clone()], named(before.path(), &looks), vec![json!({ "resize": [1280, 720] })]];
    let after_bake = [vec![small], named(after.path(), &sides)].concat();
    // Few triangles are baked sooner.
    let set = json!({ "triangles": "500" });
    let visits = json!([{ "drop": [studio()], "size": [1280, 720], "set": set, "inputs": inputs.concat(), "bake": true,
        "folder": after.path(), "after": after_bake }]);
    let one = in_page(&chromium, &visits).remove(0);
    assert_eq!(
        (&one["errors"], &one["state"], &one["compares"]),
        (&json!([]), &json!("ready"), &json!(true))
    );
    assert_seen(before.path(), &looks);
    assert_seen(after.path(), &sides);
    let soft = looks.iter().position(|(input, _)| *input == look("soft")).unwrap();
    let picture =
        |when: &str| RgbImage::load(&before.path().join(format!("{soft}-{when}.png"))).unwrap();
    let psnr = metric::psnr(&picture("before").rgb, &picture("after").rgb, None);
    assert!(psnr > 18.0, "soft is the same view as solid: {psnr:.1} dB");
    // A bake may be followed by another, and by the file.
    let hits = ["onButton", "onDownload"].map(|what| one["baked"][what].as_str());
    assert_eq!(hits, [Some("bake"), Some("files")], "{one}");
    assert_reachable(&one["baked"], 720.0);
}

/// Asserts that the button Bake is in sight.
fn assert_reachable(layout: &Value, height: f64) {
    let number = |what: &str| layout["button"][what].as_f64().unwrap();
    assert!(
        number("top") >= 0.0 && number("height") > 20.0 && number("bottom") <= height,
        "{layout}"
    );
    assert_eq!(layout["onButton"], json!("bake"));
}

/// The direction that is up where the floor of [`floor_and_board`] is level.
const FLOOR_UP: &str = "0,0.8,0.6";

/// An OBJ with a tilted floor, and a red board over it.
fn floor_and_board() -> String {
    let point = |a: f64, b: f64, height: f64| [a, 0.6 * b + 0.8 * height, 0.6 * height - 0.8 * b];
    let quad = |a: f64, b: f64, height: f64, size: f64, color: &str| {
        let corners = [[0.0, 0.0], [size, 0.0], [size, size], [0.0, size]];
        let line = |[x, y, z]: [f64; 3]| format!("v {x} {y} {z} {color}\n");
        let lines = corners.map(|[i, j]| line(point(a + i, b + j, height)));
        format!("{}f -4 -3 -2 -1\n", lines.concat())
    };
    let corner = |i: u32| [f64::from(i % 10) - 5.0, f64::from(i / 10) - 5.0];
    let cells = (0..100).map(corner).map(|[a, b]| quad(a, b, 0.0, 1.0, "0.2 0.5 0.4"));
    cells.chain([quad(-1.0, -1.0, 1.5, 2.0, "1 0 0")]).collect()
}

/// The page turns, and erases, as the program does with the option and the list that it gives.
#[test]
fn page_applies_a_clicked_up_and_bakes_without_what_is_erased() {
    let Some(chromium) = chromium().filter(|_| built()) else { return };
    let [ours, first, again, later] = [(); 4].map(|()| TempDir::new().unwrap());
    let at = |name: &str| ours.path().join(name);
    fs::write(at("floor.obj"), floor_and_board()).unwrap();
    let clicked = json!([
        { "click": "up" }, { "single": [632, 200] }, { "single": [560, 400] },
        { "single": [720, 420] }, { "click": "erase" }, { "click": "brush" },
        { "stroke": [[630, 250], [670, 260]] }, { "click": "delete" }, { "press": "Control+z" },
        { "press": "Control+y" }, { "download": "list", "to": at("list.json") },
        { "click": "save" },
    ]);
    // What is erased after that is added, and turns with the scene.
    let lasso = [[450, 320], [520, 320], [520, 390], [450, 390]];
    let more = json!([
        { "click": "erase" }, { "click": "lasso" }, { "stroke": lasso }, { "press": "Delete" },
        { "download": "list", "to": at("more.json") }, { "select": ["axis", "y"] },
        { "click": "bake" },
    ]);
    let all = [&clicked, &more].map(|inputs| inputs.as_array().unwrap().clone()).concat();
    let visit = |after: Value, again: &TempDir| {
        json!({ "files": [at("floor.obj")], "set": { "axis": "y" }, "bake": true, "size": [900, 600],
                "folder": first.path(), "after": after, "again": again.path() })
    };
    let visits = json!([visit(clicked.clone(), &again), visit(json!(all), &later)]);
    let seen = in_page(&chromium, &visits);
    for one in &seen {
        assert_eq!((&one["errors"], &one["state"]), (&json!([]), &json!("ready")), "{one}");
    }
    assert_eq!([&seen[0]["axis"], &seen[1]["axis"]], [&json!(FLOOR_UP), &json!("y")]);
    let floor = seen[0]["floor"].as_str().unwrap();
    assert!(floor.contains(&format!("--up {FLOOR_UP} (copied")), "{floor}");
    let faces = |path: &Path| mesh(path).0.face_count();
    assert_eq!(faces(&first.path().join("floor.glb")), 202);
    let runs = [(FLOOR_UP, "list.json", &again), ("y", "more.json", &later)];
    let left = runs.iter().zip(&seen).map(|((up, list, folder), one)| {
        let flags = ["--force", "--up", up, "--erase", list];
        let command = [&["bake", "floor.obj", "-o", "floor.glb"], &flags[..]].concat();
        program(ours.path(), &command).unwrap();
        assert_same(ours.path(), folder.path(), &one["again"]);
        let left = faces(&at("floor.glb"));
        let says = one["erased"].as_str().unwrap();
        assert!(says.contains(&format!("{} erased triangles", 202 - left)), "{says}, {left} left");
        left
    });
    let left: Vec<usize> = left.collect();
    assert!((197..=200).contains(&left[0]) && left[1] < left[0] - 2, "{left:?}");
}

#[test]
fn page_opens_a_dropped_file_and_shows_bake_and_picture() {
    let Some(chromium) = chromium().filter(|_| built()) else { return };
    let visits = json!([
        { "drop": [studio()], "size": [1280, 720] },
        { "drop": [studio()], "size": [390, 844], "touch": true, "inputs": [{ "click": "fold" }] },
    ]);
    let seen = in_page(&chromium, &visits);
    for (one, [width, height]) in seen.iter().zip([[1280.0, 720.0], [390.0, 844.0]]) {
        assert_eq!((&one["errors"], &one["state"]), (&json!([]), &json!("ready")), "{one}");
        assert!(one["what"].as_str().unwrap().starts_with("studio.ply: "), "{one}");
        for (when, hit) in [("start", "place"), ("opened", "picture")] {
            let hits = ["middle", "corner"].map(|place| one[when][place].as_str());
            assert_eq!(hits, [Some(hit); 2], "{when}: {one}");
        }
        assert_reachable(&one["opened"], height);
        let number = |of: &str, what: &str| one["opened"][of][what].as_f64().unwrap();
        let picture = number("picture", "width") * number("picture", "height") / (width * height);
        assert!(picture > 0.7, "the picture has {picture} of the window");
    }
    // On a phone, before anything is opened, and with the options unfolded.
    for when in ["start", "end"] {
        let panel = seen[1][when]["panel"]["height"].as_f64().unwrap();
        assert!(
            panel > 100.0 && panel <= 844.0 / 2.0,
            "{when}: the panel has {panel} px of the window"
        );
    }
}

#[test]
fn the_page_bakes_in_firefox_too() {
    let firefox = ["/usr/bin/firefox-esr", "/usr/bin/firefox"].map(PathBuf::from);
    let firefox = firefox.into_iter().find(|path| path.exists());
    let driver = here("target/judges/node_modules/puppeteer-core").exists();
    let there =
        have("firefox", firefox.is_some() && driver && Path::new("/usr/bin/xvfb-run").exists());
    let Some(firefox) = firefox.filter(|_| there && built()) else { return };
    let [ours, theirs] = [(); 2].map(|()| TempDir::new().unwrap());
    fs::copy(here("samples/soups/trained.ply"), ours.path().join("trained.ply")).unwrap();
    let mut command = Command::new("xvfb-run");
    command
        .args(["-a", "node"])
        .arg(here("tests/judges/firefox.mjs"))
        .arg(here("target/judges"))
        .arg(firefox);
    command
        .arg(here("target/web/app/index.html"))
        .arg(ours.path().join("trained.ply"))
        .arg(theirs.path());
    let seen = lines(&mut command, &json!([{}])).remove(0);
    println!("{seen}");
    assert_eq!(
        (&seen["errors"], &seen["state"], &seen["message"]),
        (&json!([]), &json!("ready"), &json!(""))
    );
    program(ours.path(), &["bake", "trained.ply", "-o", "trained.glb", "--target", "godot"])
        .unwrap();
    assert_same(ours.path(), theirs.path(), &json!(["trained.glb", "trained.glb.import"]));
}

#[test]
fn the_page_says_why_a_file_cannot_be_read() {
    let Some(chromium) = chromium().filter(|_| built()) else { return };
    let folder = TempDir::new().unwrap();
    let file = |(name, bytes): &(&str, Vec<u8>)| {
        let path = folder.path().join(name);
        fs::write(&path, bytes).unwrap();
        path
    };
    let files: Vec<PathBuf> = hostile().iter().map(file).collect();
    // A page that could not read a file takes the next one.
    let visits = json!([{ "each": files }, { "drop": [folder.path().join(PHOTO)] }]);
    let [mut each, dropped] = <[Value; 2]>::try_from(in_page(&chromium, &visits)).unwrap();
    assert_eq!(each["errors"], json!([]), "after the last file");
    let said = each["each"].as_array_mut().unwrap();
    assert_eq!(said.len(), files.len());
    let names = hostile().into_iter().map(|(name, _)| name).chain([PHOTO]);
    for (name, seen) in names.zip(said.drain(..).chain([dropped])) {
        assert_eq!((&seen["errors"], &seen["state"]), (&json!([]), &json!("failed")), "{seen}");
        let message = seen["message"].as_str().unwrap();
        assert!(message.contains(name) && !message.contains("fault"), "{message}");
        let advised = message.contains("is a photo") && message.contains("trisplat make");
        assert_eq!(advised, name == PHOTO, "{message}");
    }
}

#[test]
fn the_page_can_reach_nothing_and_is_small() {
    if !built() {
        return;
    }
    let page = fs::read_to_string(here("target/web/app/index.html")).unwrap();
    let policy = page
        .split("Content-Security-Policy\" content=\"")
        .nth(1)
        .and_then(|rest| rest.split('"').next());
    let policy = policy.expect("the page has a policy");
    assert!(
        policy.starts_with("default-src 'none'; ") && !policy.contains("connect-src"),
        "{policy}"
    );
    for word in ["unsafe-inline", "'unsafe-eval'", "*", "http", "'self'"] {
        assert!(!policy.contains(word), "{word}: {policy}");
    }
    for outside in ["<script src", "<link", "@import"] {
        assert!(!page.contains(outside), "{outside}: the page must hold all it needs");
    }
    let program =
        page.split("id=\"program\">").nth(1).and_then(|rest| rest.split('<').next()).unwrap();
    let bytes = program.len() / 4 * 3;
    println!("the program takes {bytes} bytes, compressed");
    assert!(bytes <= 3_000_000, "{bytes}");
}
