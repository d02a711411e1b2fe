//! `trisplat train --budget`: a plan that is told, and a run that can be repeated without one.

use super::train::{dataset, resume, succeed, train};
use super::{fails, stderr};
use serde_json::Value;
use std::path::Path;

fn budget(report: &Path) -> Value {
    let report: Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    let train =
        report["stages"].as_array().unwrap().iter().find(|stage| stage["name"] == "train").unwrap();
    train["details"]["budget"].clone()
}

#[test]
fn a_run_with_a_budget_is_repeated_without_it_to_the_bit() {
    let folder = tempfile::tempdir().unwrap();
    let flags = ["-o", "budget.ply", "--budget", "5s", "--report", "report.json"];
    let text = stderr(&succeed(&mut train(folder.path(), &flags)));
    assert!(text.lines().any(|line| line.starts_with("budget 5s of CPU time: ")), "{text}");
    let details = budget(&folder.path().join("report.json"));
    assert_eq!(details["corrections"].as_array().unwrap().len(), 4, "{details}");
    assert!(details["spent_secs"].as_f64().unwrap() > 0.0);
    let repeat = details["repeat"].as_str().unwrap();
    assert!(text.contains(repeat), "{text}");
    let words: Vec<String> = repeat.split(' ').map(|word| word.replace('"', "")).collect();
    let again: Vec<&str> = words.iter().map(String::as_str).chain(["-o", "again.ply"]).collect();
    succeed(&mut train(folder.path(), &again));
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(read("budget.ply") == read("again.ply"), "{repeat}");
}

#[cfg(unix)]
#[test]
fn a_run_with_a_budget_goes_on_with_what_is_left_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let flags =
        ["-o", "a.ply", "--budget", "5s", "--max-cpu-secs", "0.000001", "--report", "report.json"];
    let stopped = succeed(&mut train(folder.path(), &flags));
    let before = budget(&folder.path().join("report.json"));
    resume(folder.path(), &stderr(&stopped));
    let after = budget(&folder.path().join("report.json"));
    assert_eq!(before["plan"], after["plan"]);
    assert_eq!(after["corrections"].as_array().unwrap().len(), 4, "{after}");
    assert!(after["spent_secs"].as_f64() > before["spent_secs"].as_f64());
}

#[test]
fn budgets_that_cannot_be_kept_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let photos = dataset();
    let out = folder.path().join("a.ply");
    let base: [&dyn AsRef<std::ffi::OsStr>; 4] = [&"train", &photos, &"-o", &out];
    let with = |more: &'static [&'static str]| {
        let more: Vec<&dyn AsRef<std::ffi::OsStr>> = more.iter().map(|word| word as _).collect();
        [&base[..], &more[..]].concat()
    };
    fails(
        folder.path(),
        &with(&["--budget", "0.000001s"]),
        &["--budget is ", "expected ", "or more"],
    );
    fails(folder.path(), &with(&["--budget-wall", "0.000001s"]), &["--budget-wall is ", "or more"]);
    fails(folder.path(), &with(&["--budget", "5s", "--set", "steps=7"]), &["--set", "--budget"]);
    // Of a make, most is for the training: the message is about what was typed.
    let make: [&dyn AsRef<std::ffi::OsStr>; 6] =
        [&"make", &photos, &"-o", &"a.glb", &"--budget", &"0.02s"];
    fails(folder.path(), &make, &["--budget is 0.02s: expected ", "or more"]);
    for bad in ["0", "-1", "nan", "abc", "2m-wall"] {
        let value = format!("--budget={bad}");
        let output = super::trisplat(&[&base[..], &[&value]].concat());
        let text = stderr(&output);
        assert!(
            output.status.code() == Some(2) && text.contains("30s, 2m or 1.5h"),
            "{bad}: {text}"
        );
    }
    let both = super::trisplat(&with(&["--budget", "5s", "--steps", "7"]));
    assert!(
        both.status.code() == Some(2) && stderr(&both).contains("--steps"),
        "{}",
        stderr(&both)
    );
}

#[test]
fn a_budget_does_not_override_what_a_config_gives() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let photos = dataset();
    let out = path("a.ply");
    // The steps of the preset are given all the same.
    std::fs::write(path("steps.json"), r#"{ "steps": 8000 }"#).unwrap();
    std::fs::write(path("milestones.json"), r#"{ "milestones": [1, 2, 3, 4] }"#).unwrap();
    for (config, key) in
        [("steps.json", "--steps is 8000"), ("milestones.json", "milestones is [1, 2, 3, 4]")]
    {
        let config = path(config);
        let train: [&dyn AsRef<std::ffi::OsStr>; 8] =
            [&"train", &photos, &"-o", &out, &"--budget", &"5s", &"--config", &config];
        fails(folder.path(), &train, &[key, "left out of --config", "--budget"]);
    }
    std::fs::write(path("triangles.json"), r#"{ "max_triangles": 1500 }"#).unwrap();
    let flags =
        ["-o", "a.ply", "--budget", "5s", "--config", "triangles.json", "--report", "report.json"];
    succeed(&mut train(folder.path(), &flags));
    assert_eq!(budget(&path("report.json"))["plan"]["max_triangles"], 1500);
}
