//! What a newcomer types, and what the program says to it.

use super::{fails, sample, stderr, trisplat};
use std::path::Path;

#[test]
fn a_render_without_cameras_names_orbit() {
    let folder = tempfile::tempdir().unwrap();
    let pictures = folder.path().join("pictures");
    let scene = sample("degenerate.ply");
    fails(folder.path(), &[&"render", &scene, &"-o", &pictures], &["--orbit", "--dataset"]);
}

#[test]
fn ten_k_and_gzip_are_understood() {
    let folder = tempfile::tempdir().unwrap();
    let packed = folder.path().join("studio.ply.gz");
    let done = std::process::Command::new("gzip").arg("-c").arg(sample("studio.ply")).output();
    // Without gzip there is nothing to test it with.
    let Ok(done) = done else { return };
    std::fs::write(&packed, done.stdout).unwrap();
    let out = folder.path().join("scene.glb");
    let output = trisplat(&[
        &"bake",
        &packed,
        &"-o",
        &out,
        &"--teacher",
        &"off",
        &"--max-triangles",
        &"0.5k",
        &"-v",
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let text = stderr(&output);
    assert!(text.lines().any(|l| l.starts_with("prune") && l.contains("→ 500")), "{text}");
}

#[test]
fn a_flag_is_suggested_only_when_it_is_nearly_what_was_typed() {
    let scene = sample("degenerate.ply");
    let said = |flag: &str| stderr(&trisplat(&[&"bake", &scene, &"-o", &"x.glb", &flag]));
    let far = said("--nope");
    let near = said("--max-triangle");
    assert!(!far.contains("similar argument") && !far.contains("tip:"), "{far}");
    assert!(near.contains("--max-triangles"), "{near}");
}

#[test]
fn a_bake_says_what_happened_and_the_rest_with_v() {
    let folder = tempfile::tempdir().unwrap();
    let bake = |name: &str, more: &[&str]| {
        let scene = sample("studio.ply");
        let out = folder.path().join(name);
        let mut arguments: Vec<&dyn AsRef<std::ffi::OsStr>> =
            vec![&"bake", &scene, &"-o", &out, &"--teacher", &"off"];
        more.iter().for_each(|flag| arguments.push(flag));
        stderr(&trisplat(&arguments))
    };
    let short = bake("short.glb", &[]);
    let long = bake("long.glb", &["-v"]);
    assert!(
        !short.contains("not needed") && long.matches("not needed").count() > 5,
        "{short}\n{long}"
    );
    assert!(short.contains("wrote ") && short.lines().count() < 14, "{short}");
}

#[test]
fn presets_are_named_by_what_comes_out_and_old_names_work() {
    let help = trisplat(&[&"train", &"--help"]);
    let text = String::from_utf8_lossy(&help.stdout).into_owned();
    assert!(text.contains("soft-outdoor") && text.contains("soft-indoor"), "{text}");
    for name in ["outdoor", "soft-outdoor", "indoor", "soft-indoor"] {
        let output = trisplat(&[&"train", &"nowhere", &"-o", &"x.ply", &"--preset", &name]);
        assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    }
}

#[test]
fn a_photo_given_to_bake_names_make() {
    let folder = tempfile::tempdir().unwrap();
    let photo = folder.path().join("IMG_1.JPG");
    std::fs::write(&photo, b"\xff\xd8\xff\xe0\0\x10JFIF\0").unwrap();
    let out = folder.path().join("x.glb");
    fails(
        folder.path(),
        &[&"bake", &photo, &"-o", &out],
        &["IMG_1.JPG: is a photo", "`trisplat make`"],
    );
}

#[test]
fn a_missing_input_is_named_first_and_does_not_exist() {
    let folder = tempfile::tempdir().unwrap();
    let none = folder.path().join("none.ply");
    let out = folder.path().join("x.glb");
    let ply = folder.path().join("x.ply");
    let says = [format!("error: {}: does not exist", none.display())];
    let says = says.each_ref().map(String::as_str);
    fails(folder.path(), &[&"bake", &none, &"-o", &out], &says);
    fails(folder.path(), &[&"info", &none], &says);
    fails(folder.path(), &[&"train", &none, &"-o", &ply], &says);
    fails(folder.path(), &[&"make", &none, &"-o", &out], &says);
    fails(
        folder.path(),
        &[&"bake", &sample("degenerate.ply"), &"--dataset", &none, &"-o", &out],
        &says,
    );
}

#[test]
fn the_name_of_an_engine_suggests_its_target() {
    let said = |target: &str| {
        stderr(&trisplat(&[
            &"bake",
            &sample("degenerate.ply"),
            &"-o",
            &"x.glb",
            &"--target",
            &target,
        ]))
    };
    for engine in ["three", "three.js", "threejs", "babylon", "Cesium"] {
        let said = said(engine);
        assert!(said.contains("similar value exists: 'web'"), "{engine}: {said}");
    }
    assert!(
        said("interchange").contains("'unreal'") && !said("xy").contains("tip"),
        "{}",
        said("xy")
    );
}

#[test]
fn an_off_file_names_the_checkpoint_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    let off = folder.path().join("garden.off");
    std::fs::write(&off, "COFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 200 100 50 255\n").unwrap();
    let said = || String::from_utf8_lossy(&trisplat(&[&"info", &off]).stdout).into_owned();
    assert!(!said().contains("softness"), "{}", said());
    std::fs::write(folder.path().join("point_cloud_state_dict.pt"), "").unwrap();
    assert!(said().contains("no softness: if point_cloud_state_dict.pt beside it"), "{}", said());
}

#[test]
fn one_of_something_is_no_plural() {
    let folder = tempfile::tempdir().unwrap();
    let off = folder.path().join("a.off");
    // One of its two triangles is a point.
    let text = "COFF\n4 2 0\n0 0 0\n1 0 0\n0 1 0\n5 5 5\n3 0 1 2 9 9 9 255\n3 3 3 3 9 9 9 255\n";
    std::fs::write(&off, text).unwrap();
    let said = trisplat(&[&"info", &off]);
    let said = String::from_utf8_lossy(&said.stdout).into_owned();
    assert!(said.contains("would drop 1 triangle ("), "{said}");
    // The other one is baked and drawn.
    let glb = folder.path().join("a.glb");
    let pictures = folder.path().join("pictures");
    let said = stderr(&trisplat(&[&"bake", &off, &"-o", &glb, &"-v"]));
    assert!(said.contains(" 1 triangle ") && !said.contains(" 1 triangles"), "{said}");
    let said = stderr(&trisplat(&[
        &"render", &glb, &"-o", &pictures, &"--orbit", &"1", &"--width", &"16",
    ]));
    assert!(said.contains("wrote 1 picture to "), "{said}");
}

/// A number with its noun, as `counted` writes it, is never followed by the noun again: "520 steps
/// steps".
#[test]
fn no_noun_is_said_twice() {
    let mut counted = 0;
    for entry in std::fs::read_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("src/cli")).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read_to_string(&path).unwrap();
        for line in text.lines() {
            let Some((name, call)) =
                line.trim().strip_prefix("let ").and_then(|l| l.split_once(" = counted("))
            else {
                continue;
            };
            let Some(noun) = call.split('"').nth(1) else { continue };
            counted += 1;
            assert!(!text.contains(&format!("{{{name}}} {noun}")), "{}: {line}", path.display());
        }
    }
    assert!(counted > 1);
}
