//! `trisplat train --teacher`: a soft scene beside the photos, of a file or trained first.

use super::train::{dataset, succeed, train};
use super::{fails, sample, stderr, trisplat};
use serde_json::Value;
use std::ffi::OsStr;
use std::path::Path;
use std::process::{Command, Stdio};
use trisplat_synthetic::SyntheticOptions;

pub(super) fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn report(folder: &Path) -> Value {
    serde_json::from_slice(&read(folder, "report.json")).unwrap()
}

#[test]
fn a_teacher_is_trained_first_and_its_file_makes_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let flags =
        ["-o", "a.ply", "--teacher", "auto", "--report", "report.json", "--checkpoint-every", "20"];
    let said = stderr(&succeed(&mut train(folder, &flags)));
    assert!(said.contains("a soft teacher scene is trained first: 16 steps"), "{said}");
    let report = report(folder);
    let stages: Vec<_> =
        report["stages"].as_array().unwrap().iter().map(|stage| &stage["name"]).collect();
    assert_eq!(stages, ["evidence", "teacher", "train"]);
    assert_eq!(report["stages"][1]["details"]["steps"], 16);
    let outputs: Vec<_> =
        report["outputs"].as_array().unwrap().iter().map(|output| &output["path"]).collect();
    assert_eq!(outputs, ["a.teacher.ply", "a.ply"]);
    // The same from its file; another scene without it, and with fewer of its pictures.
    let taught = read(folder, "a.ply");
    succeed(&mut train(folder, &["-o", "b.ply", "--teacher", "a.teacher.ply"]));
    assert!(read(folder, "b.ply") == taught);
    succeed(&mut train(folder, &["-o", "b.ply", "--force"]));
    assert!(read(folder, "b.ply") != taught);
    succeed(&mut train(
        folder,
        &["-o", "b.ply", "--teacher", "a.teacher.ply", "--teacher-share", "0.2", "-f"],
    ));
    assert!(read(folder, "b.ply") != taught);
}

#[test]
fn a_run_that_goes_on_has_the_teacher_it_began_with() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let flags = ["-o", "a.ply", "--teacher", "auto", "--checkpoint-every", "20", "--keep", "3"];
    succeed(&mut train(folder, &flags));
    let scene = read(folder, "a.ply");
    let teacher = read(folder, "a.teacher.ply");
    let resume = |flags: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command.current_dir(folder).arg("train").arg(dataset()).args([
            "--max-size",
            "80",
            "--background",
            "#203040",
        ]);
        let checkpoint = ["--resume", "a.step-00000020.checkpoint", "-o", "a.ply", "--force"];
        command.args(checkpoint).args(flags).output().unwrap()
    };
    let resumed = resume(&["--teacher", "auto"]);
    assert!(resumed.status.success(), "{}", stderr(&resumed));
    assert!(!stderr(&resumed).contains("trained first"), "{}", stderr(&resumed));
    assert!(read(folder, "a.ply") == scene && read(folder, "a.teacher.ply") == teacher);
    // It is found where it was left, and missed where it is not.
    let by_default = resume(&[]);
    assert!(
        by_default.status.success() && read(folder, "a.ply") == scene,
        "{}",
        stderr(&by_default)
    );
    for without in [&["--teacher", "off"] as &[&str], &[]] {
        if without.is_empty() {
            std::fs::remove_file(folder.join("a.teacher.ply")).unwrap();
        }
        let refused = resume(without);
        assert!(
            !refused.status.success() && stderr(&refused).contains("photo"),
            "{}",
            stderr(&refused)
        );
    }
}

#[test]
fn a_budget_is_spent_on_both() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let flags = ["-o", "a.ply", "--budget", "4s", "--teacher", "auto", "--report", "report.json"];
    let said = stderr(&succeed(&mut train(folder, &flags)));
    let report = report(folder);
    let budget = |stage: usize| &report["stages"][stage]["details"]["budget"];
    // Two fifths of what is left when it begins.
    let until = budget(1)["budget"]["seconds"].as_f64().unwrap();
    assert!((1.6..4.0).contains(&until), "{until}");
    assert!(budget(2)["spent_secs"].as_f64() > budget(1)["spent_secs"].as_f64());
    // What is printed makes the same scene.
    let repeat =
        said.lines().find_map(|line| line.split_once("the same run without it: ")).unwrap().1;
    assert!(repeat.contains(" --teacher a.teacher.ply --teacher-share "), "{repeat}");
    let words: Vec<String> = repeat.split(' ').map(|word| word.replace('"', "")).collect();
    let again: Vec<&str> = words.iter().map(String::as_str).chain(["-o", "again.ply"]).collect();
    succeed(&mut train(folder, &again));
    assert!(read(folder, "a.ply") == read(folder, "again.ply"), "{repeat}");
}

/// Trains `out` in `folder` on its `photos`, few steps.
pub(super) fn train_few(folder: &Path, out: &str, flags: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.arg("train").arg(folder.join("photos")).arg("-o").arg(folder.join(out));
    command.args(flags).stdin(Stdio::null());
    command
}

pub(super) const SHORT: [&str; 4] = ["--steps", "30", "--max-triangles", "100"];

pub(super) fn few_photos(folder: &Path) {
    let options =
        SyntheticOptions { views: 9, width: 24, points: 50, ..SyntheticOptions::default() };
    std::fs::create_dir(folder.join("photos")).unwrap();
    trisplat_synthetic::write(&folder.join("photos"), &options).unwrap();
}

#[test]
fn a_run_has_only_the_teacher_that_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    few_photos(folder);
    let json = folder.join("report.json").display().to_string();
    let trains = |out: &str, more: &[&str]| {
        let flags = [&SHORT as &[&str], &["--report", &json, "--force"], more].concat();
        succeed(&mut train_few(folder, out, &flags));
        let stages = report(folder)["stages"].as_array().unwrap().clone();
        let teacher = stages.into_iter().find(|stage| stage["name"] == "teacher");
        (read(folder, out), teacher.unwrap())
    };
    let (taught, stage) = trains("a.ply", &["--teacher", "auto"]);
    assert!(stage["name"] == "teacher" && stage["details"]["steps"] == 16, "{stage}");
    assert!(folder.join("a.teacher.ply").exists());
    assert!(trains("b.ply", &["--teacher", "auto", "--teacher-share", "0.66"]).0 == taught);
    assert!(trains("b.ply", &["--teacher", "auto", "--teacher-share", "0.2"]).0 != taught);
    for (flags, why) in
        [(&[] as &[&str], "not asked for"), (&["--teacher", "off"], "`teacher` off")]
    {
        let (scene, stage) = trains("c.ply", flags);
        assert!(scene != taught && !folder.join("c.teacher.ply").exists(), "{flags:?}");
        let skipped = stage["skipped"].as_str().unwrap();
        assert!(stage["name"] == "teacher" && skipped.contains(why), "{stage}");
    }
}

#[test]
fn a_teacher_that_did_not_teach_the_run_is_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    few_photos(folder);
    let flags = [&SHORT as &[&str], &["--checkpoint-every", "20", "--keep", "3"]].concat();
    succeed(&mut train_few(folder, "b.ply", &flags));
    let scene = read(folder, "b.ply");
    std::fs::write(folder.join("b.teacher.ply"), b"no scene").unwrap();
    let checkpoint = folder.join("b.step-00000020.checkpoint").display().to_string();
    succeed(&mut train_few(folder, "b.ply", &["--resume", &checkpoint, "--force"]));
    assert!(read(folder, "b.ply") == scene);
}

#[test]
fn what_cannot_teach_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let photos = dataset();
    let out = folder.path().join("a.ply");
    let refuses = |teacher: &Path, more: &[&str], needles: &[&str]| {
        let mut words: Vec<&dyn AsRef<OsStr>> =
            vec![&"train", &photos, &"-o", &out, &"--steps", &"30"];
        words.extend([&"--teacher" as &dyn AsRef<OsStr>, &teacher]);
        words.extend(more.iter().map(|word| word as &dyn AsRef<OsStr>));
        fails(folder.path(), &words, needles);
    };
    refuses(&sample("trained.ply"), &[], &["--teacher", "trained.ply", "a soft scene"]);
    refuses(Path::new("nowhere.ply"), &[], &["nowhere.ply"]);
    std::fs::write(folder.path().join("a.teacher.ply"), b"precious").unwrap();
    refuses(Path::new("auto"), &[], &["a.teacher.ply", "--force"]);
    assert_eq!(read(folder.path(), "a.teacher.ply"), b"precious");
    let alone =
        trisplat(&[&"train", &"--from", &sample("studio.ply"), &"-o", &out, &"--teacher", &"auto"]);
    assert!(
        alone.status.code() == Some(2) && stderr(&alone).contains("DATASET"),
        "{}",
        stderr(&alone)
    );
}
