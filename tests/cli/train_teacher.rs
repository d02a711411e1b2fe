//! `trisplat train --teacher`: a soft scene beside the photos, of a file or trained first.

use super::train::{dataset, succeed, train};
use super::{fails, sample, stderr, trisplat};
use serde_json::Value;
use std::path::Path;

fn read(folder: &Path, name: &str) -> Vec<u8> {
    std::fs::read(folder.join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
}

fn report(folder: &Path) -> Value {
    serde_json::from_slice(&read(folder, "report.json")).unwrap()
}

#[test]
fn a_teacher_is_trained_first_and_its_file_makes_the_same_scene() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let flags = ["-o", "a.ply", "--teacher", "auto", "--report", "report.json", "--checkpoint-every", "20"];
    let said = stderr(&succeed(&mut train(folder, &flags)));
    assert!(said.contains("a soft scene is trained first, to teach: 16 steps"), "{said}");
    let report = report(folder);
    let stages: Vec<_> = report["stages"].as_array().unwrap().iter().map(|stage| &stage["name"]).collect();
    assert_eq!(stages, ["teacher", "train"]);
    assert_eq!(report["stages"][0]["details"]["steps"], 16);
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
    let (scene, teacher) = (read(folder, "a.ply"), read(folder, "a.teacher.ply"));
    let resume = |flags: &[&str]| {
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_trisplat"));
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
    let without = resume(&[]);
    assert!(!without.status.success() && stderr(&without).contains("photo"), "{}", stderr(&without));
}

#[test]
fn a_budget_is_spent_on_both() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let flags = ["-o", "a.ply", "--budget", "4s", "--teacher", "auto", "--report", "report.json"];
    let said = stderr(&succeed(&mut train(folder, &flags)));
    let report = report(folder);
    let budget = |stage: usize| &report["stages"][stage]["details"]["budget"];
    assert_eq!(budget(0)["budget"]["seconds"].as_f64(), Some(1.6));
    assert!(budget(1)["spent_secs"].as_f64() > budget(0)["spent_secs"].as_f64());
    // What is printed makes the same scene.
    let repeat = said.lines().find_map(|line| line.split_once("the same run without it: ")).unwrap().1;
    assert!(repeat.ends_with(" --teacher a.teacher.ply"), "{repeat}");
    let words: Vec<String> = repeat.split(' ').map(|word| word.replace('"', "")).collect();
    let again: Vec<&str> = words.iter().map(String::as_str).chain(["-o", "again.ply"]).collect();
    succeed(&mut train(folder, &again));
    assert!(read(folder, "a.ply") == read(folder, "again.ply"), "{repeat}");
}

#[test]
fn what_cannot_teach_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let (photos, out) = (dataset(), folder.path().join("a.ply"));
    let refuses = |teacher: &Path, more: &[&str], needles: &[&str]| {
        let mut words: Vec<&dyn AsRef<std::ffi::OsStr>> =
            vec![&"train", &photos, &"-o", &out, &"--steps", &"30"];
        words.extend([&"--teacher" as &dyn AsRef<std::ffi::OsStr>, &teacher]);
        words.extend(more.iter().map(|word| word as &dyn AsRef<std::ffi::OsStr>));
        fails(folder.path(), &words, needles);
    };
    refuses(&sample("trained.ply"), &[], &["--teacher", "trained.ply", "a soft scene"]);
    refuses(Path::new("nowhere.ply"), &[], &["nowhere.ply"]);
    refuses(Path::new("auto"), &["--max-cpu-secs", "1e-9"], &["--teacher", "1 of 16 steps"]);
    std::fs::write(folder.path().join("a.teacher.ply"), b"precious").unwrap();
    refuses(Path::new("auto"), &[], &["a.teacher.ply", "--force"]);
    assert_eq!(read(folder.path(), "a.teacher.ply"), b"precious");
    let alone = trisplat(&[&"train", &"--from", &sample("studio.ply"), &"-o", &out, &"--teacher", &"auto"]);
    assert!(alone.status.code() == Some(2) && stderr(&alone).contains("DATASET"), "{}", stderr(&alone));
}
