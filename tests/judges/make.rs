//! `trisplat make` of photos alone, through pycolmap, after a run that was killed.

use super::{assert_valid, have, here, runs};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};
use tempfile::TempDir;

/// Longest time until pycolmap looks at the second photo.
const PATIENCE: Duration = Duration::from_secs(120);

fn trisplat(folder: &Path, words: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.current_dir(folder).args(words).stdin(Stdio::null()).stdout(Stdio::null());
    command
}

#[test]
fn photos_alone_become_a_file_through_pycolmap() {
    let python = here("target/judges/venv/bin/python");
    let probe =
        Command::new(&python).args(["-c", "import pycolmap"]).stderr(Stdio::null()).status();
    if !have("pycolmap", probe.is_ok_and(|status| status.success())) {
        return;
    }
    let folder = TempDir::new().unwrap();
    let sample = here("samples/soups/trained.ply");
    let mut photos =
        trisplat(folder.path(), &["render", "--as", "solid", "--orbit", "24", "--width", "400"]);
    assert!(photos.arg(&sample).args(["-o", "photos", "-q"]).status().unwrap().success());
    let make = || {
        let words =
            ["make", "photos", "-o", "scene.glb", "--steps", "200", "--max-triangles", "2000"];
        let mut command = trisplat(folder.path(), &words);
        // pycolmap finds another number of points each time, and now and then too few for a
        // training that is not told to go on.
        command
            .args(["--max-size", "200", "--anyway"])
            .env("TRISPLAT_POSES", &python)
            .stderr(Stdio::piped());
        command
    };
    // Killed as pycolmap works: it must not disturb the next run.
    let mut killed = make().stderr(Stdio::null()).spawn().unwrap();
    let log = folder.path().join("scene.make/photos/capture/poses.log");
    let began = Instant::now();
    let second = "Processed file [2/24]";
    while !std::fs::read_to_string(&log).is_ok_and(|text| text.contains(second)) {
        assert!(
            began.elapsed() < PATIENCE && killed.try_wait().unwrap().is_none(),
            "{}",
            log.display()
        );
        std::thread::sleep(Duration::from_millis(20));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();

    let done = runs(make().arg("--report").arg("report.json"));
    let said = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success(), "{said}");
    for part in ["photos     not needed: done before", "pycolmap ", "open scene.html in a browser"]
    {
        assert!(said.contains(part), "{part}: {said}");
    }
    let text = std::fs::read_to_string(folder.path().join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&text).unwrap();
    let stages = report["stages"].as_array().unwrap();
    let details =
        |name: &str| &stages.iter().find(|stage| stage["name"] == name).unwrap()["details"];
    assert!(details("model")["registered"].as_u64().unwrap() >= 20, "{}", details("model"));
    // Features of the killed run would have left photos with a camera of their own.
    let cameras =
        std::fs::read(folder.path().join("scene.make/photos/sparse/0/cameras.bin")).unwrap();
    assert_eq!(cameras[..8], 1u64.to_le_bytes(), "all photos share a camera");
    let psnr = details("train")["psnr"].as_f64().unwrap();
    assert!(psnr > 12.0, "{psnr} dB: the poses are wrong");
    // The scene is written first, then its subject alone.
    let written = stages.iter().find(|stage| stage["name"] == "write").unwrap();
    let triangles = written["after"]["triangles"].as_u64().unwrap();
    if have("gltf-validator", here("target/judges/node_modules/gltf-validator").exists()) {
        assert_valid(&[(folder.path().join("scene.glb"), triangles)]);
    }
}
