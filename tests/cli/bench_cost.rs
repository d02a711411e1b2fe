//! `trisplat bench cost` as a user meets it.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn cost(args: &[&str]) -> Output {
    let dataset = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset");
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.args(["bench", "cost"]).arg(dataset).args(["--max-size", "64"]).args(args).output().unwrap()
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} of {value}"))
}

#[test]
fn a_grid_says_which_steps_and_triangles_to_use() {
    let grid =
        ["--steps", "20,160", "--max-triangles", "300,1200", "--budget", "1h", "--seeds", "2", "--json"];
    let output = cost(&grid);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    let cells = report["cells"].as_array().unwrap();
    let sizes: Vec<_> = cells.iter().map(|c| (number(c, "steps"), number(c, "max_triangles"))).collect();
    assert_eq!(sizes, [(20.0, 300.0), (160.0, 300.0), (20.0, 1200.0), (160.0, 1200.0)]);
    // More steps and more triangles come closer, and cost more.
    let (least, most) = (&cells[0], &cells[3]);
    assert!(number(most, "psnr") > number(least, "psnr") + 1.0, "{report}");
    assert!(number(most, "cpu_seconds") > number(least, "cpu_seconds"), "{report}");
    for cell in cells {
        let runs = cell["runs"].as_array().unwrap();
        assert!(runs.len() == 2 && runs[0]["psnr"] != runs[1]["psnr"], "seeds must differ: {cell}");
        assert!(number(cell, "psnr_band") > 0.0 && number(cell, "cpu_seconds") > 0.0, "{cell}");
    }
    // Photos that are held out are not looked at, and those watched are not trained on.
    let held_out = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset/test.txt");
    let held_out = std::fs::read_to_string(held_out).unwrap();
    let watched: Vec<&str> = report["watched"].as_array().unwrap().iter().filter_map(Value::as_str).collect();
    assert!(watched.len() >= 3 && watched.iter().all(|name| !held_out.contains(name)), "{watched:?}");
    let advice = &report["advice"];
    let sentence = advice["sentence"].as_str().unwrap();
    assert!(said.trim_end().ends_with(sentence), "{said}");
    assert!(sentence.starts_with(&format!("use --steps {} --max-triangles ", advice["steps"])), "{sentence}");
    assert_eq!(report["photo_size"], "64x48");
}

#[test]
fn a_budget_ends_the_grid() {
    let output =
        cost(&["--steps", "20,40000000", "--max-triangles", "300", "--budget", "2m", "--seeds", "1"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    assert!(said.contains("what more time would give was not measured"), "{said}");
    assert!(!said.contains("40000000") && !said.contains('±'), "one seed has no band: {said}");
}

#[test]
fn what_makes_no_grid_is_refused() {
    for (args, part) in [
        (&["--steps", "200,100"][..], "--steps is 200,100: expected numbers that ascend"),
        (&["--seeds", "0"], "--seeds"),
    ] {
        let output = cost(args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(part), "{args:?}: {message}");
    }
}
