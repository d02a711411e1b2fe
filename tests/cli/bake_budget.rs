//! `trisplat bake --budget`: less is drawn and fitted, it is told, and the same file can be made without a budget.

use super::{sample, stderr, trisplat};
use serde_json::Value;
use std::ffi::OsStr;
use std::path::Path;

/// Bakes `input` in `folder` with `flags`; returns what was printed and the report.
fn bake(folder: &Path, input: &Path, out: &str, flags: &[&str]) -> (String, Value) {
    let (out, report) = (folder.join(out), folder.join("report.json"));
    let mut args: Vec<&dyn AsRef<OsStr>> = vec![&"bake", &input, &"-f", &"-o", &out, &"--report", &report];
    args.extend([&"--preset" as &dyn AsRef<OsStr>, &"default"]);
    args.extend(flags.iter().map(|flag| flag as &dyn AsRef<OsStr>));
    let output = trisplat(&args);
    assert!(output.status.success(), "{}", stderr(&output));
    let report = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    (stderr(&output), report)
}

fn stage<'r>(report: &'r Value, name: &str) -> &'r Value {
    report["stages"].as_array().unwrap().iter().find(|stage| stage["name"] == name).unwrap()
}

#[test]
fn a_bake_with_a_budget_is_repeated_without_it_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let studio = sample("studio.ply");
    let secs = |report: &Value| stage(report, "budget")["details"]["spent_secs"].as_f64().unwrap();
    // What all of it takes here and now, and half of that.
    let (_, all) = bake(folder.path(), &studio, "all.glb", &["--budget", "1h"]);
    let budget = format!("{}s", secs(&all) / 2.0);
    let (text, report) = bake(folder.path(), &studio, "budget.glb", &["--budget", &budget]);
    let details = &stage(&report, "budget")["details"];
    assert!(secs(&report) < secs(&all), "{details} of {all}");
    let repeat = details["repeat"].as_str().expect("half the time makes less");
    assert!(!details["reasons"].as_array().unwrap().is_empty());
    assert!(text.contains(repeat) && text.contains("budget     "), "{text}");
    let words: Vec<&str> = repeat.split(' ').collect();
    bake(folder.path(), &studio, "again.glb", &words);
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(read("budget.glb") == read("again.glb"), "{repeat}");

    // With time for everything it is the file that it would be without.
    assert_eq!(stage(&all, "budget")["details"].get("repeat"), None, "{all}");
    bake(folder.path(), &studio, "plain.glb", &[]);
    assert!(read("all.glb") == read("plain.glb"));
}

#[test]
fn a_budget_too_small_for_anything_is_a_plain_conversion_and_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let studio = sample("studio.ply");
    let (text, report) = bake(folder.path(), &studio, "a.glb", &["--budget", "0.001s"]);
    assert!(text.contains("warning: the bake took ") && text.contains("more than --budget 0.001s"), "{text}");
    assert!(stage(&report, "teacher")["unneeded"].as_str().unwrap().contains("`budget` leaves no time"));
    assert!(text.contains("teacher    not needed: --budget leaves no time"), "{text}");
    assert_eq!(stage(&report, "budget")["details"]["repeat"], "--teacher off");
    bake(folder.path(), &studio, "b.glb", &["--teacher", "off"]);
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(read("a.glb") == read("b.glb"));
}

#[test]
fn a_solid_scene_leaves_nothing_to_choose() {
    let folder = tempfile::tempdir().unwrap();
    let trained = sample("trained.ply");
    let (text, report) = bake(folder.path(), &trained, "a.glb", &["--budget", "1h"]);
    assert!(stage(&report, "budget")["unneeded"].as_str().unwrap().contains("nothing is soft"));
    assert!(text.contains("budget     not needed: nothing is soft"), "{text}");
}

#[test]
fn a_budget_for_several_bakes_or_for_training_is_refused() {
    let (studio, folder) = (sample("studio.ply"), tempfile::tempdir().unwrap());
    let out = folder.path().join("a.glb");
    for other in [&["--max-bytes", "1MB"][..], &["--harden"]] {
        let mut args: Vec<&dyn AsRef<OsStr>> = vec![&"bake", &studio, &"-o", &out, &"--budget", &"5s"];
        args.extend(other.iter().map(|flag| flag as &dyn AsRef<OsStr>));
        let output = trisplat(&args);
        assert!(
            output.status.code() == Some(2) && stderr(&output).contains("--budget"),
            "{}",
            stderr(&output)
        );
    }
}
