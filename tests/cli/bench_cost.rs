//! `trisplat bench cost` as a user meets it.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn cost(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trisplat"))
        .args(["bench", "cost", "--json"])
        .args(args)
        .output()
        .unwrap()
}

/// Rows of a sweep of the sample's photos, with trainings of a second.
fn rows(more: &[&str]) -> Vec<Value> {
    let dataset = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset");
    let small = ["--max-size", "64", "--steps", "120", "--max-triangles", "1000", dataset.to_str().unwrap()];
    let output = cost(&[&small, more].concat());
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

fn number(row: &Value, key: &str) -> f64 {
    row[key].as_f64().unwrap_or_else(|| panic!("{key} of {row}"))
}

fn find<'a>(rows: &'a [Value], stage: &str, knob: &str, value: &str) -> &'a Value {
    let found = rows
        .iter()
        .find(|r| (&r["stage"], &r["knob"], &r["value"]) == (&stage.into(), &knob.into(), &value.into()));
    found.unwrap_or_else(|| panic!("no row {stage} {knob}={value}"))
}

#[test]
fn trainings_differ_by_seed_and_cost_what_their_steps_cost() {
    let rows = rows(&["--stage", "train", "--knob", "steps", "--runs", "2"]);
    assert_eq!(rows.len(), 4, "the default, a half, a quarter and twice the steps");
    let (default, twice) = (find(&rows, "train", "default", ""), find(&rows, "train", "steps", "240"));
    assert!(number(default, "psnr_spread") > 0.0, "seeds must differ: {default}");
    assert!(number(twice, "cpu_ratio") > 1.05 && number(twice, "cpu_seconds") > 0.0, "{twice}");
    assert!(number(twice, "psnr") > number(default, "psnr"), "{default} {twice}");
    assert!(number(default, "psnr") > 9.0, "{default}");
    assert_eq!((&twice["default_value"], &twice["runs"]), (&"120".into(), &2.into()));
    for row in &rows {
        assert!(number(row, "peak_bytes") > 1e6 && number(row, "bytes") > 1e3 && row["commit"].is_string());
        let beaten = row["on_front"] == Value::Bool(row["beaten_by"].is_null());
        assert!(beaten, "{row}");
    }
    assert!(rows.iter().any(|row| row["on_front"] == true));
}

#[test]
fn a_bake_is_compared_with_what_is_not_quantised() {
    let narrow = ["compress", "target", "order", "bvh"].map(|name| ["--knob", name]).concat();
    let rows = rows(&[&narrow[..], &["--stage", "bake", "--runs", "1"]].concat());
    assert_eq!(rows.len(), 9, "the default, seven values and a pair");
    let small = find(&rows, "bake", "compress+target", "true+web");
    let order = find(&rows, "bake", "order", "none");
    let (default, bvh) = (find(&rows, "bake", "default", ""), find(&rows, "bake", "bvh", "true"));
    // Another order shows in a sample where two triangles are at the very same depth, and nowhere else.
    for reordered in [order, bvh] {
        assert!(number(reordered, "exact_rms") < 0.1, "{reordered}");
    }
    let moved = number(small, "exact_rms");
    assert!(moved > 0.0 && moved < 3.0, "quantised positions move pictures a little: {moved}");
    assert!(
        number(small, "bytes") < number(default, "bytes") && number(bvh, "bytes") > number(default, "bytes")
    );
    assert!(default["skipped"].as_str().unwrap().split(' ').any(|stage| stage == "lod"), "{default}");
    assert!(default["cpu_spread"].is_null(), "one run has no spread");
}

#[test]
fn drawings_are_compared_with_the_exact_answer_and_the_rest_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (csv, page, plot) = (at("cost.csv"), at("cost.html"), at("cost.svg"));
    let rows = rows(&["--stage", "draw", "--runs", "1", "--csv", &csv, "--page", &page, "--plot", &plot]);
    let exact = |knob: &str, value: &str| number(find(&rows, "draw", knob, value), "exact_rms");
    let of_file = rows.iter().find(|r| r["input"] == "file" && r["is_default"] == true).unwrap();
    assert!(exact("ssaa", "1") > exact("ssaa", "2") && exact("ssaa", "2") > number(of_file, "exact_rms"));
    assert!(number(of_file, "exact_rms") > 0.0, "16 samples are not 64");
    assert!(exact("cutoff", "0.1") > exact("cutoff", "0.03"));
    assert!(exact("min_transmittance", "0.1") >= exact("min_transmittance", "0"));
    let of_soup = rows.iter().find(|r| r["input"] == "soft-soup" && r["is_default"] == true).unwrap();
    assert!(exact("sort_per_pixel", "true") < number(of_soup, "exact_rms"));
    let (one, four) = (find(&rows, "draw", "ssaa", "1"), of_file);
    assert!(number(one, "cpu_seconds") < number(four, "cpu_seconds"), "{one}");

    let table = std::fs::read_to_string(csv).unwrap();
    assert_eq!(table.lines().count(), 1 + rows.len());
    let columns = table.lines().map(|line| line.split(',').count());
    assert!(columns.clone().all(|count| count == columns.clone().next().unwrap()), "{table}");
    assert!(table.contains(",,") && !table.contains("null"), "what is absent is empty: {table}");
    assert!(rows.iter().all(|row| row["photo_size"] == "64x48"), "{}", rows[0]);
    let page = std::fs::read_to_string(page).unwrap();
    assert_eq!(
        page.matches("data:image/jpeg;base64,").count(),
        rows.len() + 1,
        "a picture per row, and the photo"
    );
    assert!(std::fs::read_to_string(plot).unwrap().contains("default"));
}

#[test]
fn what_cannot_be_swept_is_refused() {
    for (args, part) in [
        (&["--knob", "nonsense"][..], "--knob is nonsense: expected one of"),
        (&["--knob", "bvh", "--stage", "train"], "max_triangles"),
        (&["/no/such/photos"], "/no/such/photos"),
        (&["--stage", "chain"], "chain"),
    ] {
        let output = cost(args);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(!output.status.success() && message.contains(part), "{args:?}: {message}");
    }
}
