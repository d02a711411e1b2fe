//! `trisplat bake --max-bytes`: files of at most the given number of bytes, and hardly fewer.

use super::train::dataset;
use super::{fails, sample, stderr, trisplat};
use serde_json::Value;
use std::path::Path;

#[test]
fn max_bytes_counts_view_dependent_colours() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.glb");
    let output = trisplat(&[
        &"bake",
        &sample("trained.ply"),
        &"--dataset",
        &dataset(),
        &"--sh",
        &"1",
        &"--max-bytes",
        &"300kB",
        &"-o",
        &out,
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let bytes = std::fs::read(&out).unwrap();
    assert!((200_000..=300_000).contains(&bytes.len()), "{}", bytes.len());
    assert!(bytes.windows(11).any(|word| word == b"trisplat_sh"));
}

#[test]
fn files_take_no_more_bytes_than_they_may() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let bytes = |name: &str| std::fs::metadata(path(name)).unwrap().len();
    let studio = sample("studio.ply");
    assert!(
        trisplat(&[&"bake", &studio, &"-o", &path("whole.glb"), &"--preset", &"fast"])
            .status
            .success()
    );
    let whole = bytes("whole.glb");

    let limit = whole / 2;
    let size = format!("{limit}B");
    let out = path("half.glb");
    let report = path("report.json");
    let output = trisplat(&[
        &"bake",
        &studio,
        &"-o",
        &out,
        &"--preset",
        &"fast",
        &"--max-bytes",
        &size,
        &"--report",
        &report,
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(bytes("half.glb") <= limit && bytes("half.glb") as f64 > 0.95 * limit as f64);

    // The report says how many triangles that were; they make the same file.
    let report: Value = serde_json::from_slice(&std::fs::read(&report).unwrap()).unwrap();
    let most = report["options"]["prune"]["max_triangles"].as_u64().unwrap().to_string();
    assert!(
        trisplat(&[
            &"bake",
            &studio,
            &"-o",
            &path("again.glb"),
            &"--max-triangles",
            &most,
            &"--preset",
            &"fast"
        ])
        .status
        .success()
    );
    assert!(std::fs::read(path("again.glb")).unwrap() == std::fs::read(&out).unwrap());

    // What fits anyway is the file that it would be without a limit.
    assert!(
        trisplat(&[
            &"bake",
            &studio,
            &"-o",
            &path("all.glb"),
            &"--max-bytes",
            &"1GB",
            &"--preset",
            &"fast"
        ])
        .status
        .success()
    );
    assert!(std::fs::read(path("all.glb")).unwrap() == std::fs::read(path("whole.glb")).unwrap());
}

#[test]
fn the_files_beside_it_count_too() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scene.gltf");
    let output = trisplat(&[
        &"bake",
        &sample("studio.ply"),
        &"-o",
        &out,
        &"--preset",
        &"fast",
        &"--lod",
        &"0.5",
        &"--max-bytes",
        &"200kB",
    ]);
    assert!(output.status.success(), "{}", stderr(&output));
    let files = std::fs::read_dir(folder.path()).unwrap();
    let sum: u64 = files.map(|file| file.unwrap().metadata().unwrap().len()).sum();
    assert!(sum <= 200_000 && sum > 150_000, "{sum}");
}

#[test]
fn sizes_that_hold_nothing_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let studio = sample("studio.ply");
    let out = folder.path().join("scene.glb");
    fails(
        folder.path(),
        &[&"bake", &studio, &"-o", &out, &"--max-bytes", &"100", &"--preset", &"fast"],
        &["--max-bytes is 100: expected ", "or more"],
    );
    for bad in ["0", "-5MB", "nan", "abc", "5TB"] {
        let flag = format!("--max-bytes={bad}");
        let output = trisplat(&[&"bake", &studio, &"-o", &out, &flag]);
        let text = stderr(&output);
        assert!(output.status.code() == Some(2) && text.contains("as in 5MB"), "{bad}: {text}");
    }
}

/// The triangles of a GLB, and those of its backdrop.
fn triangles(file: &Path) -> [u64; 2] {
    let scene = trisplat::read(file).unwrap();
    [scene.triangle_count() as u64, scene.provenance().backdrop_faces.into()]
}

/// Mean PSNR on the held-out photos of the sample.
fn psnr(file: &Path, report: &Path) -> f64 {
    let photos = dataset();
    let output =
        trisplat(&[&"eval", &file, &photos, &"--max-size", &"120", &"--report", &report, &"-f"]);
    assert!(output.status.success(), "{}", stderr(&output));
    let report: Value = serde_json::from_slice(&std::fs::read(report).unwrap()).unwrap();
    report["steps"][0]["mean"]["psnr"].as_f64().unwrap()
}

/// A limit counts the surroundings too, and leaves the scene what one looks at: a GLB is cut as
/// well without its photos.
#[test]
fn limits_count_surroundings_which_take_an_eighth_at_most() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let soup = sample("trained.ply");
    let photos = dataset();
    let bake = |input: &Path, out: &str, more: &[&str]| {
        let words: Vec<&dyn AsRef<std::ffi::OsStr>> = more.iter().map(|word| word as _).collect();
        let out = path(out);
        let bake: [&dyn AsRef<std::ffi::OsStr>; 4] = [&"bake", &input, &"-o", &out];
        let output = trisplat(&[&bake[..], &words].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        out
    };
    let with_photos =
        |more: &[&'static str]| [&["--dataset", photos.to_str().unwrap()], more].concat();
    let whole = bake(&soup, "whole.glb", &with_photos(&["--backdrop", "sphere"]));
    let [all, behind] = triangles(&whole);
    assert!(all > 3000 && behind > 300, "{all} {behind}");
    for (most, input, photos) in
        [(1500, &whole, false), (300, &whole, false), (1500, &soup, true), (100, &soup, true)]
    {
        let limit = most.to_string();
        let limit: [&str; 2] = ["--max-triangles", &limit];
        let more = if photos { [&with_photos(&[])[..], &limit].concat() } else { limit.to_vec() };
        let [all, behind] =
            triangles(&bake(input, &format!("{most}.glb"), &[&more[..], &["-f"]].concat()));
        assert!(all <= most && all > most / 2 && behind <= most / 8, "{most}: {all} {behind}");
        assert!(behind > 0 || most < 256 || photos, "{most}: the surroundings are there");
    }
    let limit = ["--max-bytes", "90kB"];
    let from_soup = bake(&soup, "soup.glb", &with_photos(&limit));
    let from_glb = bake(&whole, "glb.glb", &limit);
    assert!(std::fs::metadata(&from_glb).unwrap().len() <= 90_000);
    let [soup, glb] = [from_soup, from_glb].map(|file| psnr(&file, &path("eval.json")));
    assert!(glb > soup - 1.0, "{glb:.2} dB of the GLB, {soup:.2} dB of the soup and photos");
}
