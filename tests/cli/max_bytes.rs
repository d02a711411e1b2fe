//! `trisplat bake --max-bytes`: files of at most the given number of bytes, and hardly fewer.

use super::{fails, sample, stderr, trisplat};
use serde_json::Value;

#[test]
fn files_take_no_more_bytes_than_they_may() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let bytes = |name: &str| std::fs::metadata(path(name)).unwrap().len();
    let studio = sample("studio.ply");
    assert!(trisplat(&[&"bake", &studio, &"-o", &path("whole.glb"), &"--preset", &"fast"]).status.success());
    let whole = bytes("whole.glb");

    let limit = whole / 2;
    let size = format!("{limit}B");
    let (out, report) = (path("half.glb"), path("report.json"));
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
        trisplat(&[&"bake", &studio, &"-o", &path("all.glb"), &"--max-bytes", &"1GB", &"--preset", &"fast"])
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
    let (studio, out) = (sample("studio.ply"), folder.path().join("scene.glb"));
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
