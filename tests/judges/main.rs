//! Outside judges look at what `trisplat bake` writes: the Khronos glTF validator, trimesh, Open3D,
//! Chromium, Godot 3 and 4. `tests/run.sh` installs them and requires them; without them a test
//! says that it is skipped.

#![allow(
    clippy::print_stderr,
    clippy::print_stdout,
    reason = "a test that is skipped says so, and tables are for people"
)]

mod browser;
mod editors;
mod engines;
mod framing;
mod levels;
mod lit;
mod make;
mod page;
mod renderers;
mod sh;
mod sky;
mod textured;
mod tiles;
mod usdz;
mod web;

use serde_json::Value;
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;
use trisplat_formats::{ReadOptions, ply, read};
use trisplat_scene::{Provenance, Scene, Soup, math::color::srgb_from_linear};

const TARGETS: [&str; 8] =
    ["gltf", "godot", "godot3", "unity", "unreal", "blender", "web", "playcanvas"];
/// Flags under which the output holds every triangle of a valid source unchanged.
const EVERYTHING: [&str; 6] =
    ["--set", "solid=none", "--set", "min_opacity=0", "--set", "max_sigma=0"];

/// A path below the package.
fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

fn studio() -> PathBuf {
    here("samples/soups/studio.ply")
}

/// The studio of few triangles, for pages that draw it a hundred times without a graphics card.
fn small_studio(folder: &Path) -> PathBuf {
    let path = folder.join("studio.ply");
    trisplat_fixtures::samples::studio(&path, 800);
    path
}

/// Real data that is not part of the package.
fn shared(name: &str) -> Option<PathBuf> {
    let path = here("../shared/soups").join(name);
    if !path.exists() {
        trisplat_fixtures::skip::skipped(&format!("no ../shared/soups/{name}"));
        return None;
    }
    Some(path)
}

/// True when a judge is there. A required one that is not fails the test.
fn have(judge: &str, there: bool) -> bool {
    let required = std::env::var("TRISPLAT_REQUIRE_JUDGES").unwrap_or_default();
    if !there {
        assert!(
            required != "1" && !required.split(',').any(|name| name == judge),
            "{judge} is required and missing: tests/run.sh installs it"
        );
        trisplat_fixtures::skip::skipped(&format!("no {judge}: tests/run.sh installs it"));
    }
    there
}

fn runs(command: &mut Command) -> Output {
    command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"))
}

/// Runs with `input` on standard input.
fn runs_with(command: &mut Command, input: &[u8]) -> Output {
    let piped = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = piped.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    child.stdin.take().unwrap().write_all(input).unwrap();
    child.wait_with_output().unwrap()
}

/// Bakes and returns the number of triangles written.
fn bake(input: &Path, output: &Path, flags: &[&str]) -> u64 {
    let report = PathBuf::from(format!("{}.report.json", output.display()));
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    // What is written is checked here, not how it is fitted.
    command.arg("bake").arg(input).arg("-o").arg(output).arg("--report").arg(&report);
    command.args(["--teacher", "off", "-q"]).args(flags);
    if input == studio() {
        // What judges see is compared with the source, triangle by triangle, and its dome is one of
        // two sides there.
        command.args(["--backdrop", "off"]);
    }
    let done = runs(&mut command);
    assert!(done.status.success(), "{command:?}: {}", String::from_utf8_lossy(&done.stderr));
    let report: Value = serde_json::from_slice(&fs::read(&report).unwrap()).unwrap();
    let last = report["stages"].as_array().unwrap().last().unwrap();
    last["after"]["triangles"].as_u64().unwrap()
}

// --- Khronos glTF validator
// -------------------------------------------------------------------------

/// Asserts that the validator finds nothing at all to say about files of some numbers of triangles.
fn assert_valid(files: &[(PathBuf, u64)]) {
    let mut command = Command::new("node");
    command
        .arg(here("tests/judges/validate.mjs"))
        .arg(here("target/judges"))
        .args(files.iter().map(|(path, _)| path));
    let done = runs(&mut command);
    let lines: Vec<Value> = done
        .stdout
        .split(|&b| b == b'\n')
        .filter_map(|line| serde_json::from_slice(line).ok())
        .collect();
    assert_eq!(lines.len(), files.len(), "{}", String::from_utf8_lossy(&done.stderr));
    for (found, (path, triangles)) in lines.iter().zip(files) {
        let clean =
            ["numErrors", "numWarnings", "numInfos", "numHints"].iter().all(|key| found[key] == 0);
        assert!(clean, "{}: {found}", path.display());
        assert_eq!(found["triangles"].as_u64(), Some(*triangles), "{}", path.display());
    }
}

fn validator() -> bool {
    have("gltf-validator", here("target/judges/node_modules/gltf-validator").exists())
}

#[test]
fn every_target_is_valid_gltf() {
    if !validator() {
        return;
    }
    let folder = TempDir::new().unwrap();
    let mut sources = vec![studio(), here("samples/soups/degenerate.ply")];
    sources.extend(
        ["guitar_20k.pt", "guitar_tri.off", "guitar_tri.ply"].into_iter().filter_map(shared),
    );
    let mut files = Vec::new();
    for source in &sources {
        let name = source.file_name().unwrap().to_str().unwrap();
        for target in TARGETS {
            let path = folder.path().join(format!("{name}-{target}.glb"));
            let triangles = bake(source, &path, &["--target", target]);
            files.push((path, triangles));
        }
        let path = folder.path().join(format!("{name}-levels.glb"));
        let triangles = bake(source, &path, &["--lod", "0.5,0.2"]);
        let level = |share: f64| ((triangles as f64 * share) as usize).max(1) as u64;
        files.push((path.with_extension("lod1.glb"), level(0.5)));
        files.push((path.with_extension("lod2.glb"), level(0.2)));
        let path = folder.path().join(format!("{name}.gltf"));
        let triangles = bake(source, &path, &["--set", "chunk_triangles=500"]);
        files.push((path, triangles));
    }
    assert_valid(&files);
}

#[test]
fn small_files_are_valid_gltf() {
    if !validator() {
        return;
    }
    let folder = TempDir::new().unwrap();
    let mut files = Vec::new();
    for target in TARGETS {
        let path = folder.path().join(format!("{target}.glb"));
        let flags = ["--preset", "small", "--target", target, "--set", "chunk_triangles=1000"];
        let triangles = bake(&studio(), &path, &flags);
        files.push((path, triangles));
    }
    // The validator does not look into EXT_meshopt_compression: what the compressed file decodes to
    // must be, bit for bit, its twin that is only quantised, and that one is looked at.
    let at = |target: &str| TARGETS.iter().position(|name| *name == target).unwrap();
    let (web, _) = files.remove(at("web"));
    let (unity, _) = &files[at("unity")];
    assert!(fs::metadata(&web).unwrap().len() < fs::metadata(unity).unwrap().len());
    let scene = |path: &Path| read(path, &ReadOptions::with_degree(0)).unwrap().scene;
    assert_eq!(scene(&web), scene(unity));
    assert_valid(&files);
}

// --- trimesh and Open3D
// -----------------------------------------------------------------------------

const JUDGES: [&str; 2] = ["trimesh", "open3d"];

/// The Python that has the judge, when it is there.
fn python(judge: &str) -> Option<Command> {
    let python = here("target/judges/venv/bin/python");
    let folder = python.with_file_name("../lib").read_dir().ok();
    let packages =
        folder.into_iter().flatten().flatten().map(|python| python.path().join("site-packages"));
    let there = packages.into_iter().any(|packages| packages.join(judge).exists());
    have(judge, there).then(|| {
        let mut command = Command::new(python);
        command.arg("-B");
        command
    })
}

/// The judge's script under the Python that has it, when it is there.
fn script(judge: &str) -> Option<Command> {
    python(judge).map(|mut command| {
        command.arg(here(&format!("samples/check_{judge}.py")));
        command
    })
}

/// Asserts that a judge sees in the files what the source holds.
fn assert_as_source(judge: &str, source: &Path, files: &[PathBuf], flags: &[&str]) {
    let Some(mut command) = script(judge) else { return };
    let done = runs(command.args(flags).arg(source).args(files));
    assert!(done.status.success(), "{command:?}\n{}", String::from_utf8_lossy(&done.stderr));
}

/// Bakes `source` under `flags` into one file of each name.
fn bakes(folder: &Path, source: &Path, names: &[&str], flags: &[&str]) -> Vec<PathBuf> {
    let one = |name: &&str| {
        let path = folder.join(name);
        bake(source, &path, flags);
        path
    };
    names.iter().map(one).collect()
}

#[test]
fn judges_see_every_triangle_of_the_studio() {
    let folder = TempDir::new().unwrap();
    let all = |more: &[&'static str]| [&EVERYTHING[..], more].concat();
    let plain = bakes(folder.path(), &studio(), &["a.glb", "a.gltf", "a.obj", "a.ply"], &all(&[]));
    let chunks =
        bakes(folder.path(), &studio(), &["chunks.glb"], &all(&["--set", "chunk_triangles=700"]));
    let godot = bakes(folder.path(), &studio(), &["4.glb"], &all(&["--target", "godot"]));
    let godot3 = bakes(folder.path(), &studio(), &["3.glb"], &all(&["--target", "godot3"]));
    let welded =
        bakes(folder.path(), &studio(), &["weld.glb", "weld.ply"], &all(&["--set", "weld=on"]));
    let faces =
        bakes(folder.path(), &studio(), &["faces.ply"], &all(&["--set", "ply_face_colors=true"]));
    let moved = ["--up", "z", "--set", "scale=2.5", "--set", "center=true"];
    let moved = bakes(folder.path(), &studio(), &["m.glb", "m.obj", "m.ply"], &all(&moved));
    for judge in JUDGES {
        let mut files = [&plain[..], &chunks, &godot, &godot3, &welded].concat();
        // Open3D reads no colours of faces.
        files.extend(faces.iter().filter(|_| judge == "trimesh").cloned());
        assert_as_source(judge, &studio(), &files, &["--up=-y", "--scale=1"]);
        assert_as_source(judge, &studio(), &moved, &["--up=z", "--scale=2.5"]);
    }
}

#[test]
fn judges_see_the_solid_studio() {
    let folder = TempDir::new().unwrap();
    for (preset, solid) in [("default", "auto"), ("fast", "contour"), ("default", "area")] {
        let path = folder.path().join(format!("{preset}-{solid}.glb"));
        let triangles =
            bake(&studio(), &path, &["--preset", preset, "--set", &format!("solid={solid}")])
                .to_string();
        for judge in JUDGES {
            assert_as_source(
                judge,
                &studio(),
                std::slice::from_ref(&path),
                &["--expect-shrunk", "--triangles", &triangles],
            );
        }
    }
}

#[test]
fn judges_see_real_scenes() {
    let folder = TempDir::new().unwrap();
    for name in ["guitar_20k.pt", "guitar_tri.off", "guitar_tri.ply"] {
        let Some(source) = shared(name) else { continue };
        let files = [format!("{name}.glb"), format!("{name}.obj"), format!("{name}.out.ply")];
        let files = files.each_ref().map(String::as_str);
        let exact = bakes(folder.path(), &source, &files, &EVERYTHING);
        let solid = folder.path().join(format!("{name}.solid.glb"));
        let triangles = bake(&source, &solid, &[]).to_string();
        for judge in JUDGES {
            assert_as_source(judge, &source, &exact, &[]);
            let flags = ["--expect-shrunk", "--triangles", &triangles];
            assert_as_source(judge, &source, std::slice::from_ref(&solid), &flags);
        }
    }
}

/// The studio with one thing wrong, by name.
fn damaged() -> Vec<(&'static str, Soup)> {
    let Scene::Soup(whole) = read(&studio(), &ReadOptions::with_degree(0)).unwrap().scene else {
        panic!("the sample is a soup");
    };
    let mut color = whole.clone();
    let mut vertex = whole.clone();
    let mut missing = whole.clone();
    color.sh[4321][1] += if color.rgb(4321)[1] < 0.5 { 0.03 } else { -0.03 }; // 2.2 of 255
    vertex.vertices[1234][2].y += 1e-3;
    missing.retain(|i| i != 7000);
    vec![("color", color), ("vertex", vertex), ("missing", missing)]
}

#[test]
fn judges_fail_damaged_files() {
    let folder = TempDir::new().unwrap();
    let mut files = Vec::new();
    for (what, soup) in damaged() {
        let source = folder.path().join(format!("{what}.soup.ply"));
        let mut bytes = Vec::new();
        ply::write_soup(&mut bytes, &soup, &Provenance::default(), &[]).unwrap();
        fs::write(&source, bytes).unwrap();
        let names = ["glb", "obj", "ply"].map(|ending| format!("{what}.{ending}"));
        // The dome of the studio is no backdrop here, as judges compare with all of the source.
        let flags = [&EVERYTHING[..], &["--backdrop", "off"]].concat();
        files.extend(bakes(folder.path(), &source, &names.each_ref().map(String::as_str), &flags));
    }
    for judge in JUDGES {
        // Each of them alone must fail; --damaged turns the verdict of every file round.
        assert_as_source(judge, &studio(), &files, &["--damaged"]);
        if let Some(mut command) = script(judge) {
            let done = runs(command.arg(studio()).arg(&files[0]));
            assert_eq!(done.status.code(), Some(1), "{judge}");
            assert!(
                String::from_utf8_lossy(&done.stderr).contains("colour"),
                "{judge} says what is wrong"
            );
        }
    }
}

// --- Godot
// ------------------------------------------------------------------------------------------

/// Godot 3 on the project in `folder`, which is also its home.
fn godot3(folder: &Path, flags: &[&str]) -> Command {
    let mut command = Command::new("godot3-server");
    command.args(["--audio-driver", "Dummy", "--path"]).arg(folder).args(flags);
    command.env("HOME", folder).env_remove("XDG_CONFIG_HOME").env_remove("XDG_DATA_HOME");
    command
}

/// Ends the editor however the test ends.
struct Editor(Child);

impl Drop for Editor {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// Lets Godot 3's editor import what is in `folder`. Without a screen it never exits by itself, so
/// it is ended once the checksum of the import is there, which is what it writes last.
fn import(folder: &Path) {
    let log = fs::File::create(folder.join("editor.log")).unwrap();
    let mut command = godot3(folder, &["--editor", "--quit"]);
    let _editor = Editor(command.stdout(log.try_clone().unwrap()).stderr(log).spawn().unwrap());
    let clock = Instant::now();
    let done = |entry: fs::DirEntry| entry.path().extension().is_some_and(|ending| ending == "md5");
    while !fs::read_dir(folder.join(".import")).is_ok_and(|files| files.flatten().any(done)) {
        let said = || fs::read_to_string(folder.join("editor.log")).unwrap_or_default();
        assert!(clock.elapsed() < Duration::from_secs(120), "Godot imports nothing: {}", said());
        std::thread::sleep(Duration::from_millis(100));
    }
}

/// A project with the studio as `scene.glb`, baked for `target`, and a script that dumps what came
/// in.
fn project(scripts: &str, target: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    for file in ["project.godot", "dump.gd"] {
        fs::copy(here(scripts).join(file), folder.path().join(file)).unwrap();
    }
    let scene = folder.path().join("scene.glb");
    bake(&studio(), &scene, &["--target", target, "--set", "chunk_triangles=3000", "--collision"]);
    folder
}

/// Asserts that the dump holds every node, vertex and colour of `scene.glb`; `said` is what the
/// script said.
fn assert_same_scene(folder: &Path, said: &str) {
    let Scene::Mesh(mesh) =
        read(&folder.join("scene.glb"), &ReadOptions::with_degree(0)).unwrap().scene
    else {
        panic!("a GLB is a mesh");
    };
    let nodes: Vec<Vec<&str>> = said
        .lines()
        .filter(|line| line.starts_with("node "))
        .map(|line| line.split(' ').collect())
        .collect();
    assert!(nodes.len() >= 3, "{said}");
    assert!(
        nodes.iter().all(|node| node[2] == node[3] && node[4].eq_ignore_ascii_case("true")),
        "{said}"
    );
    let body = format!("body collision {}", engines::collision_faces(&folder.join("scene.glb")));
    assert!(said.lines().any(|line| line == body), "{body} is not in {said}");
    let vertices: usize = nodes.iter().map(|node| node[2].parse::<usize>().unwrap()).sum();
    assert_eq!(vertices, mesh.vertex_count());

    let mut wants = Vec::new();
    for face in 0..mesh.face_count() {
        for (position, color) in mesh.corners(face).into_iter().zip(mesh.corner_colors(face)) {
            wants.extend(position.to_array().into_iter().flat_map(f32::to_le_bytes));
            wants.extend(color.map(|channel| (255.0 * srgb_from_linear(channel)).round() as u8));
        }
    }
    let got = fs::read(folder.join("dump.bin")).unwrap();
    assert!(got == wants, "a position or an 8-bit colour code is not the one in the file");
}

#[test]
fn godot_3_imports_every_vertex_and_color() {
    if have("godot3", Command::new("godot3-server").arg("--version").output().is_ok()) {
        let folder = project("tests/judges/godot3", "godot3");
        import(folder.path());
        let said = runs(&mut godot3(folder.path(), &["--script", "dump.gd"]));
        assert_same_scene(folder.path(), &String::from_utf8_lossy(&said.stdout));
    }
}

/// The real one: `tests/judges/godot4.sh` installs it.
#[test]
fn godot_4_imports_every_vertex_and_color() {
    let godot4 = here("target/judges/godot4");
    if have("godot4", godot4.exists()) {
        let folder = project("tests/judges/godot4", "godot");
        let said = ["--import", "--script=dump.gd"].map(|what| {
            let words = what.split('=');
            let done = runs(Command::new(&godot4).arg(folder.path()).args(words));
            String::from_utf8_lossy(&done.stdout).into_owned()
        });
        assert_same_scene(folder.path(), &said[1]);
        let import = fs::read_to_string(folder.path().join("scene.glb.import")).unwrap();
        assert!(
            import.contains("uid=") && import.contains("generate_lods=false"),
            "our settings are kept: {import}"
        );
    }
}
