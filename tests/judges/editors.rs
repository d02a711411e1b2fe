//! The add-ons of `editors`, installed in the editors that run here.

use super::{assert_same_scene, have, here, project, runs, studio};
use serde_json::Value;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use tempfile::TempDir;
use trisplat_fixtures::folders::copy_folder;
use trisplat_formats::{ReadOptions, read};
use trisplat_scene::{Scene, math::color::srgb_from_linear};

/// Godot imports a dropped scene by the add-on: the same nodes, positions, colours and ground as
/// from a GLB that was baked by hand.
#[test]
fn a_scene_that_is_dropped_into_godot_4_is_baked_by_the_add_on() {
    let godot4 = here("target/judges/godot4");
    if !have("godot4", godot4.exists()) {
        return;
    }
    // A GLB of the same flags, which Godot does not import here, is what must come in.
    let folder = project("tests/judges/godot4", "godot");
    let at = |name: &str| folder.path().join(name);
    fs::remove_file(at("scene.glb.import")).unwrap();
    copy_folder(&here("editors/godot/addons"), &at("addons"));
    // Godot may run where this program's folder is not.
    let programs = TempDir::new().unwrap();
    fs::copy(env!("CARGO_BIN_EXE_trisplat"), programs.path().join("trisplat")).unwrap();
    // Neither what a project says nor what lies in it is run.
    fs::write(at("trisplat"), "#!/bin/sh\ntouch ran\n").unwrap();
    fs::write(at("not-this"), "#!/bin/sh\ntouch ran\n").unwrap();
    fs::copy(studio(), at("scene.ply")).unwrap();
    let settings = "\n[editor_plugins]\n\nenabled=PackedStringArray(\"res://addons/trisplat/plugin.cfg\")\n\
        \n[trisplat]\n\nprogram=\"res://not-this\"\n";
    fs::write(at("project.godot"), fs::read_to_string(at("project.godot")).unwrap() + settings)
        .unwrap();
    let more = ["chunk_triangles=3000", "teacher=off"].map(|word| format!("\"{word}\""));
    let params = format!(
        "[remap]\n\nimporter=\"trisplat.scene\"\ntype=\"PackedScene\"\n\n[params]\n\nquality=0\nharden=false\n\
        max_triangles=0\ncollision=true\nbackdrop=false\nscale=1.0\nsettings=PackedStringArray({})\n",
        more.join(", ")
    );
    fs::write(at("scene.ply.import"), params).unwrap();
    // A file of no known format ends in one error that names it.
    fs::write(at("broken.spz"), "nothing").unwrap();

    let path = format!(".::{}", programs.path().display());
    let imported = runs(
        Command::new(&godot4)
            .arg(folder.path())
            .arg("--import")
            .env("PATH", path)
            .current_dir(&folder),
    );
    assert!(!at("ran").exists());
    let said = [imported.stdout, imported.stderr]
        .map(|said| String::from_utf8_lossy(&said).into_owned())
        .concat();
    assert!(said.contains("trisplat cannot bake res://broken.spz: error: "), "{said}");
    let done = runs(Command::new(&godot4).arg(folder.path()).args(["--script", "dump.gd"]));
    let dumped = String::from_utf8_lossy(&done.stdout).into_owned();
    assert!(!said.contains("SCRIPT ERROR"), "{said}");
    assert_same_scene(folder.path(), &dumped);
}

/// Whether there is a compiler for C#.
pub(super) fn has_mcs() -> bool {
    have("mcs", Command::new("mcs").arg("--version").output().is_ok())
}

/// Compiles scripts against declarations of Unity's functions.
pub(super) fn compile_for_unity(out: &Path, sources: &[PathBuf]) {
    let kind = if out.extension().is_some_and(|end| end == "exe") { "exe" } else { "library" };
    let mut compile = Command::new("mcs");
    compile.args(["-define:UNITY_EDITOR", "-warnaserror", "-nowarn:0649", "-r:System.Xml.dll"]);
    compile.args(["-r:System.Runtime.Serialization.dll", &format!("-target:{kind}")]);
    let done = runs(
        compile
            .arg(format!("-out:{}", out.display()))
            .arg(here("tests/judges/unity/editor.cs"))
            .args(sources),
    );
    let said =
        [done.stdout, done.stderr].map(|said| String::from_utf8_lossy(&said).into_owned()).concat();
    assert!(done.status.success(), "{said}");
}

/// The importer for Unity makes the meshes, colours and ground that a GLB baked by hand has; its
/// editor is not here, so stand-ins for its functions hold what it makes.
#[test]
fn a_scene_that_is_dropped_into_unity_is_baked_by_the_importer() {
    if !has_mcs() {
        return;
    }
    let folder = project("tests/judges/godot4", "godot");
    let at = |name: &str| folder.path().join(name);
    let mut sources = vec![here("tests/judges/unity/import.cs")];
    let scripts =
        fs::read_dir(here("editors/unity/Editor")).unwrap().map(|file| file.unwrap().path());
    sources.extend(scripts.filter(|path| path.extension().is_some_and(|end| end == "cs")));
    compile_for_unity(&at("import.exe"), &sources);
    let import = |program: &str, scene: &Path, flags: &[&str]| {
        let mut command = Command::new("mono");
        let done = runs(
            command.arg(at("import.exe")).arg(program).arg(scene).arg(at("dump.bin")).args(flags),
        );
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        String::from_utf8_lossy(&done.stdout).into_owned()
    };
    let program = env!("CARGO_BIN_EXE_trisplat");
    let said = import(program, &studio(), &["chunk_triangles=3000", "teacher=off"]);
    assert_same_scene(folder.path(), &said);
    // By default what lies behind comes too, drawn from inside only.
    let said = import(program, &here("samples/soups/trained.ply"), &[]);
    assert!(
        said.lines().any(|line| line.starts_with("node backdrop ") && line.ends_with("False")),
        "{said}"
    );
    let lost = import(program, &at("missing.ply"), &[]);
    assert!(
        lost.starts_with("error trisplat cannot bake ") && lost.contains("does not exist"),
        "{lost}"
    );
    // What a project sets is an option and its value, whatever it looks like.
    let lost = import(program, &studio(), &["--force"]);
    assert!(lost.starts_with("error ") && lost.contains("--force"), "{lost}");
    for program in ["no-such-program", "./trisplat", "editors/trisplat", ""] {
        let lost = import(program, &studio(), &[]);
        assert!(
            lost.starts_with("error ") && lost.contains("Preferences > Trisplat"),
            "{program}: {lost}"
        );
    }
    let words = ["a b\\", "\\\\host\\", "\"a\"", "", "--report $X `y`", "a\\\"b"];
    let said = runs(
        Command::new("mono")
            .arg(at("import.exe"))
            .args(["--quoted", "/usr/bin/printf", "%s\\n"])
            .args(words),
    );
    assert_eq!(String::from_utf8_lossy(&said.stdout).lines().collect::<Vec<_>>(), words);
    let lost = import("no-such-program", &studio(), &[]);
    assert!(lost.starts_with("error ") && lost.contains("Preferences > Trisplat"), "{lost}");
}

/// Unity leaves out files of an installed package that have no `.meta`, and tells assets apart by
/// the GUID in it.
#[test]
fn every_file_of_the_package_for_unity_has_its_own_guid() {
    let mut folders = vec![here("editors/unity")];
    let mut guids = BTreeSet::new();
    while let Some(folder) = folders.pop() {
        for path in fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.extension().is_some_and(|end| end == "meta") {
                assert!(path.with_extension("").exists(), "{} is of no file", path.display());
                continue;
            }
            let meta = fs::read_to_string(format!("{}.meta", path.display())).unwrap();
            let guid = meta.lines().find_map(|line| line.strip_prefix("guid: ")).unwrap();
            assert!(
                guid.len() == 32 && guids.insert(guid.to_owned()),
                "{}: {guid}",
                path.display()
            );
            if path.is_dir() {
                folders.push(path);
            }
        }
    }
    assert!(guids.len() >= 8, "{guids:?}");
}

/// A name is sought in absolute folders of the PATH: the function of the extension, without
/// Blender.
#[cfg(unix)]
#[test]
fn blender_extension_runs_no_program_of_the_current_folder() {
    let source = fs::read_to_string(here("editors/blender/__init__.py")).unwrap();
    let found =
        &source[source.find("def found(").unwrap()..source.find("class IMPORT_SCENE").unwrap()];
    let folder = TempDir::new().unwrap();
    let program = folder.path().join("trisplat");
    fs::write(&program, "").unwrap();
    runs(Command::new("chmod").arg("+x").arg(&program));
    let script = format!(
        "import os\n{found}\nimport sys\nprint(*[found(name) for name in sys.argv[1:]], sep='\\n')"
    );
    let said = |path: &str| {
        let mut python = Command::new("/usr/bin/env");
        let python3 =
            python.args(["python3", "-c", &script, "trisplat", "./trisplat", ""]).arg(&program);
        let done = runs(python3.env("PATH", format!("{path}:/usr/bin:/bin")).current_dir(&folder));
        String::from_utf8_lossy(&done.stdout).lines().map(str::to_owned).collect::<Vec<_>>()
    };
    let whole = program.display().to_string();
    assert_eq!(said(".:"), ["None", "None", "None", &whole]);
    assert_eq!(said(&folder.path().display().to_string()), [&whole, "None", "None", &whole]);
}

#[test]
fn blender_imports_a_scene_by_the_extension() {
    imports_by_the_extension(&here("target/judges/venv/bin/python"), "bpy");
}

/// Extensions of others broke with Blender 5.
#[test]
fn the_newest_blender_imports_a_scene_by_the_extension() {
    imports_by_the_extension(&here("target/judges/bpy/bin/python"), "bpy-newest");
}

/// Blender installs the extension from its archive, and imports every corner and colour that the
/// program bakes.
fn imports_by_the_extension(python: &Path, judge: &str) {
    let there = Command::new(python)
        .args(["-c", "import bpy"])
        .output()
        .is_ok_and(|done| done.status.success());
    if !have(judge, there) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let at = |name: &str| folder.path().join(name);
    let zip = "import shutil, sys; shutil.make_archive(sys.argv[2][:-4], 'zip', sys.argv[1])";
    let extension = at("trisplat.zip");
    let packed =
        runs(Command::new(python).args(["-c", zip]).arg(here("editors/blender")).arg(&extension));
    assert!(packed.status.success(), "{}", String::from_utf8_lossy(&packed.stderr));
    let mut command = Command::new(python);
    command
        .arg(here("tests/judges/blender/import.py"))
        .arg(&extension)
        .arg(env!("CARGO_BIN_EXE_trisplat"));
    command.arg(studio()).arg(at("dump.bin")).env("BLENDER_USER_RESOURCES", folder.path());
    let done = runs(&mut command);
    let said = String::from_utf8_lossy(&done.stdout);
    let errors = String::from_utf8_lossy(&done.stderr);
    let line = said
        .lines()
        .find(|line| line.starts_with('{'))
        .unwrap_or_else(|| panic!("{said}\n{errors}"));
    let said: Value = serde_json::from_str(line).unwrap();
    let failed = said["failed"].as_str().unwrap();
    assert!(failed.contains(".missing") && failed.contains("does not exist"), "{failed}");
    assert_eq!(said["done"], serde_json::json!(["FINISHED"]));
    assert_eq!((&said["camera"], &said["colors"]), (&true.into(), &"Standard".into()));
    assert_eq!(said["hidden"].as_object().unwrap().len(), 1, "{said}");

    let scene = at("scene.glb");
    let flags =
        ["--target", "blender", "--collision", "--max-triangles", "2000", "--set", "reshape=auto"];
    let done = runs(
        Command::new(env!("CARGO_BIN_EXE_trisplat"))
            .arg("bake")
            .arg(studio())
            .arg("-o")
            .arg(&scene)
            .args(flags),
    );
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let mut loaded = read(&scene, &ReadOptions::with_degree(0)).unwrap();
    loaded.take_backdrop();
    let Scene::Mesh(mesh) = loaded.scene else { panic!("a GLB is a mesh") };
    assert_eq!(said["drawn"], mesh.face_count());
    let dump = fs::read(at("dump.bin")).unwrap();
    let mut records = dump.chunks_exact(15);
    for face in 0..mesh.face_count() {
        for (position, color) in mesh.corners(face).into_iter().zip(mesh.corner_colors(face)) {
            let (place, codes) = records.next().unwrap().split_at(12);
            let got = [0, 4, 8].map(|i| f32::from_le_bytes(place[i..i + 4].try_into().unwrap()));
            assert_eq!(got, position.to_array(), "corner of face {face}");
            // Blender rounds colours between two codes in its own way.
            let wants = color.map(|channel| (255.0 * srgb_from_linear(channel)).round() as u8);
            assert!(
                (0..3).all(|c| wants[c].abs_diff(codes[c]) <= 1),
                "{wants:?} {codes:?} of face {face}"
            );
        }
    }
    assert_eq!(records.len(), 0);
}
