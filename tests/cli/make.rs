//! `trisplat make`: everything in one command, and on again after a stop.

use super::stderr;
use super::train::dataset;
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn make(folder: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.current_dir(folder).arg("make").arg(dataset()).args(["-o", "scene.glb", "--max-size", "60"]);
    command
        .args(["--budget", "6s", "--max-triangles", "500"])
        .args(more)
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

#[test]
fn a_data_set_becomes_a_file_and_a_page_and_its_training_is_not_repeated() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let first = make(folder.path(), &["--report", "a.json"]);
    let said = stderr(&first);
    assert!(first.status.success(), "{said}");
    assert!(said.contains("capture    not needed: the photos have poses"), "{said}");
    assert!(said.contains("of the 6s of --budget, most are for training"), "{said}");
    assert!(said.contains("photos that training did not see") && said.contains("open scene.html"), "{said}");
    let glb = std::fs::read(at("scene.glb")).unwrap();
    assert!(glb.starts_with(b"glTF") && std::fs::read_to_string(at("scene.html")).unwrap().contains("<html"));
    let report: serde_json::Value = serde_json::from_slice(&std::fs::read(at("a.json")).unwrap()).unwrap();
    let stages = report["stages"].as_array().unwrap();
    let has = |name: &str| stages.iter().any(|stage| stage["name"] == name);
    assert!(has("capture") && has("train") && has("refit") && has("write"), "{stages:?}");
    assert_eq!(report["outputs"].as_array().unwrap().len(), 2, "{report}");

    // Nothing is replaced without --force.
    let refused = make(folder.path(), &[]);
    assert!(refused.status.code() == Some(1) && stderr(&refused).contains("--force"), "{}", stderr(&refused));
    let again = make(folder.path(), &["--force"]);
    assert!(again.status.success() && stderr(&again).contains("(done before)"), "{}", stderr(&again));
    assert!(std::fs::read(at("scene.glb")).unwrap() == glb, "the same scene");
}

#[test]
fn finding_poses_comes_on_top_of_the_budget() {
    let folder = tempfile::tempdir().unwrap();
    for photo in ["a.jpg", "b.jpg", "c.jpg"] {
        std::fs::write(folder.path().join(photo), b"no photo").unwrap();
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command
        .current_dir(folder.path())
        .args(["make", "a.jpg", "b.jpg", "c.jpg", "-o", "a.glb", "--budget", "90s"]);
    let said = stderr(&command.stdin(Stdio::null()).output().unwrap());
    assert!(said.contains("camera poses are found first; the 90s of --budget"), "{said}");
}

#[test]
fn names_that_cannot_be_written_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    for (output, wants) in
        [("-", "a file for an engine"), ("a.html", "a file for an engine"), ("no/a.glb", "a folder")]
    {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command.current_dir(folder.path()).arg("make").arg(dataset()).args(["-o", output]);
        let output = command.stdin(Stdio::null()).output().unwrap();
        assert!(output.status.code() == Some(1) && stderr(&output).contains(wants), "{}", stderr(&output));
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}
