//! The program as its user meets it.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// The root of the repository.
fn at(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

fn bench(args: &[&str], folder: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trisplat-bench"))
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn cost(args: &[&str]) -> Output {
    bench(&[&["cost", "samples/dataset", "--max-size", "64"], args].concat(), &at(""))
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} of {value}"))
}

#[test]
fn a_grid_says_which_steps_and_triangles_to_use() {
    let grid = [
        "--steps",
        "20,160",
        "--max-triangles",
        "300,1200",
        "--budget",
        "1h",
        "--seeds",
        "2",
        "--json",
    ];
    let output = cost(&grid);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let cells = report["cells"].as_array().unwrap();
    let sizes: Vec<_> =
        cells.iter().map(|c| (number(c, "steps"), number(c, "max_triangles"))).collect();
    assert_eq!(sizes, [(20.0, 300.0), (160.0, 300.0), (20.0, 1200.0), (160.0, 1200.0)]);
    // More steps and more triangles come closer, and cost more.
    let least = &cells[0];
    let most = &cells[3];
    assert!(number(most, "psnr") > number(least, "psnr") + 1.0, "{report}");
    assert!(number(most, "cpu_seconds") > number(least, "cpu_seconds"), "{report}");
    for cell in cells {
        let runs = cell["runs"].as_array().unwrap();
        assert!(runs.len() == 2 && runs[0]["psnr"] != runs[1]["psnr"], "seeds must differ: {cell}");
        assert!(number(cell, "psnr_band") > 0.0 && number(cell, "cpu_seconds") > 0.0, "{cell}");
    }
    // Photos that are held out are not looked at, and those watched are not trained on.
    let held_out = std::fs::read_to_string(at("samples/dataset/test.txt")).unwrap();
    let watched: Vec<&str> =
        report["watched"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert!(
        watched.len() >= 3 && watched.iter().all(|name| !held_out.contains(name)),
        "{watched:?}"
    );
    let sentence = report["advice"].as_str().unwrap();
    assert!(said.trim_end().ends_with(sentence) && sentence.starts_with("use --steps "), "{said}");
    assert_eq!(report["photo_size"], "64x48");
}

#[test]
fn a_budget_ends_the_grid() {
    let output = cost(&[
        "--steps",
        "20,40000000",
        "--max-triangles",
        "300",
        "--budget",
        "2m",
        "--seeds",
        "1",
    ]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    assert!(said.contains("what more time would give was not measured"), "{said}");
    assert!(!said.contains("40000000") && !said.contains('±'), "one seed has no band: {said}");
}

#[test]
fn what_makes_no_grid_is_refused() {
    for (args, part) in [
        (&["--steps", "200,100"][..], "steps is 200,100: expected numbers that ascend"),
        (&["--seeds", "0"], "--seeds"),
    ] {
        let output = cost(args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(part), "{args:?}: {message}");
    }
}

#[test]
fn samples_equal_the_repository_and_replace_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let make = ["sample", "studio", "-o", "a.ply"];
    assert!(bench(&make, folder.path()).status.success());
    let made = std::fs::read(folder.path().join("a.ply")).unwrap();
    assert!(made == std::fs::read(at("samples/soups/studio.ply")).unwrap());
    let photos =
        ["sample", "dataset", "-o", "photos", "--views", "3", "--width", "16", "--points", "20"];
    assert!(bench(&photos, folder.path()).status.success());
    for again in [&make[..], &photos] {
        let output = bench(again, folder.path());
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(
            output.status.code() == Some(1)
                && said.contains("--output")
                && said.contains("--force"),
            "{said}"
        );
        assert!(bench(&[again, &["--force"]].concat(), folder.path()).status.success());
    }
    assert!(made == std::fs::read(folder.path().join("a.ply")).unwrap());
}

#[test]
fn stress_prints_its_promises_and_a_case_can_be_replayed() {
    let output = bench(&["stress", "--cases", "2000", "--json"], &at(""));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let frames = &report["promises"][0];
    assert_eq!(frames["name"], "frames");
    let again = bench(&["stress", "--replay", &frames["worst"].to_string()], &at(""));
    let said = String::from_utf8_lossy(&again.stderr).into_owned();
    let found = format!("{:.3e}", frames["found"].as_f64().unwrap());
    assert!(
        said.lines().any(|line| line.starts_with("frames") && line.ends_with(&found)),
        "{found}: {said}"
    );
}

/// The program that is measured is not built with these tests: a script stands in for it.
#[cfg(unix)]
#[test]
fn bakes_are_measured_beside_the_floor() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let fake = folder.path().join("trisplat");
    std::fs::write(&fake, "#!/bin/sh\nhead -c 1000 \"$4\" >\"$6\"\n").unwrap();
    std::fs::set_permissions(&fake, PermissionsExt::from_mode(0o755)).unwrap();
    let bake = ["bake", "--triangles", "2000", "--runs", "1", "--json", "--trisplat", "./trisplat"];
    let output = bench(&bake, folder.path());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let rows: Vec<Value> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(rows.len(), 5);
    assert!(
        rows.iter().all(|row| row["output_bytes"] == 1000 && number(row, "wall_seconds") > 0.0),
        "{rows:?}"
    );
}
