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
    let output =
        trisplat(&[&"bake", &packed, &"-o", &out, &"--teacher", &"off", &"--max-triangles", &"0.5k", &"-v"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let text = stderr(&output);
    assert!(text.lines().any(|l| l.starts_with("prune") && l.contains("→ 500")), "{text}");
}

#[test]
fn a_flag_is_suggested_only_when_it_is_nearly_what_was_typed() {
    let scene = sample("degenerate.ply");
    let said = |flag: &str| stderr(&trisplat(&[&"bake", &scene, &"-o", &"x.glb", &flag]));
    let (far, near) = (said("--nope"), said("--max-triangle"));
    assert!(!far.contains("similar argument") && !far.contains("tip:"), "{far}");
    assert!(near.contains("--max-triangles"), "{near}");
}

#[test]
fn a_bake_says_what_happened_and_the_rest_with_v() {
    let folder = tempfile::tempdir().unwrap();
    let bake = |name: &str, more: &[&str]| {
        let (scene, out) = (sample("studio.ply"), folder.path().join(name));
        let mut arguments: Vec<&dyn AsRef<std::ffi::OsStr>> =
            vec![&"bake", &scene, &"-o", &out, &"--teacher", &"off"];
        more.iter().for_each(|flag| arguments.push(flag));
        stderr(&trisplat(&arguments))
    };
    let (short, long) = (bake("short.glb", &[]), bake("long.glb", &["-v"]));
    assert!(!short.contains("not needed") && long.matches("not needed").count() > 5, "{short}\n{long}");
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

/// A number with its noun, as `counted` writes it, is never followed by the noun again: "520 steps steps".
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
