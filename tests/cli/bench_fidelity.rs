//! `trisplat bench fidelity`: quality of a file, step by step.

use super::fidelity::{fail, inputs, sample, trisplat};
use trisplat_bench::fidelity::FidelityRow;

/// Rows of `bench fidelity` on the sample's photos.
fn bench(more: &[&str]) -> Vec<FidelityRow> {
    let dataset = sample("dataset");
    let args =
        [&["bench", "fidelity", dataset.to_str().unwrap(), "--json", "--max-size", "64"], more].concat();
    let output = trisplat(&args);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn every_step_from_a_soup_to_files_is_measured() {
    let (soup, _, folder) = inputs();
    let [csv, plot] = ["rows.csv", "rows.svg"].map(|n| folder.path().join(n).to_str().unwrap().to_owned());
    let rows = bench(&["--soup", &soup, "--csv", &csv, "--plot", &plot]);
    let find = |case: &str, target: &str| {
        let row = rows.iter().find(|r| {
            r.case == case && r.target == target && r.ssaa == if target.is_empty() { 1 } else { 4 }
        });
        row.unwrap_or_else(|| panic!("no row {case} {target}"))
    };
    let soft = find("soft", "");
    assert_eq!((soft.change, soft.bake_secs, soft.soup.as_str()), (0.0, 0.0, soup.as_str()));
    for preset in ["fast", "default", "small"] {
        for target in ["gltf", "godot", "godot3", "unity", "unreal", "blender", "web", "playcanvas"] {
            let row = find(preset, target);
            let like = find(preset, "gltf");
            assert!((row.psnr - like.psnr).abs() < 0.1, "{preset} {target}: {} dB", row.psnr);
            assert_eq!(row.triangles, like.triangles);
        }
    }
    // The dome is a node of its own, which is compressed by itself.
    assert!(find("small", "web").bytes * 9 < find("small", "gltf").bytes * 5);
    assert!(find("refit", "gltf").psnr >= find("unseen", "gltf").psnr - 0.05);
    assert!(find("quarter", "gltf").triangles * 3 < find("refit", "gltf").triangles);
    assert_eq!(std::fs::read_to_string(&csv).unwrap().lines().count(), rows.len() + 1);
    assert!(std::fs::read_to_string(&plot).unwrap().contains("\ntriangles\n"));
    let dataset = sample("dataset");
    let budget = ["bench", "fidelity", dataset.to_str().unwrap(), "--soup", &soup, "--soft", &soup];
    fail(&[&budget[..], &["--steps", "9"]].concat(), &["--steps", "--soup"]);
}

#[test]
fn without_a_soup_one_is_trained() {
    let rows = bench(&["--steps", "12", "--max-triangles", "400"]);
    assert_eq!(rows[0].soup, "solid 12 steps");
    assert_eq!(rows[0].case, "soft");
    // So few steps leave hardly a triangle; what the bake puts behind them is not counted as trained.
    assert!(rows.iter().all(|r| r.psnr.is_finite() && (1..=400 + 128).contains(&r.triangles)));
    let find = |case: &str| rows.iter().find(|r| r.case == case && r.ssaa == 4).unwrap();
    assert!(find("unseen").psnr > find("plain").psnr + 2.0, "holes are closed, in the photos' colours");
    assert!(find("refit").psnr > find("unseen").psnr - 0.1, "and hardly a triangle is left to be fitted");
}
