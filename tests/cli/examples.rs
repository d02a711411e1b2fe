//! The programs in `examples` do what they say.

use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat::read;
use trisplat_synthetic::SyntheticOptions;

/// Runs an example in `folder` and returns what it prints.
fn run(name: &str, folder: &Path, arguments: &[&str]) -> String {
    let program =
        PathBuf::from(env!("CARGO_BIN_EXE_trisplat")).with_file_name("examples").join(name);
    let program = program.with_extension(std::env::consts::EXE_EXTENSION);
    assert!(program.is_file(), "{} is not built: cargo build --examples", program.display());
    let done =
        Command::new(program).current_dir(folder).args(arguments).output().expect("it starts");
    assert!(done.status.success(), "{name}: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).expect("it prints text")
}

/// A file of the samples.
fn sample(name: &str) -> String {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("samples")
        .join(name)
        .to_str()
        .expect("a plain path")
        .to_owned()
}

#[test]
fn the_example_bakes_with_the_preset_that_it_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let scene = sample("soups/trained.ply");
    let printed = run("bake", folder.path(), &[&scene, "scene.glb"]);
    let program = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    let arguments = ["bake", &scene, "-o", "same.glb", "--preset", "small"];
    assert!(
        { program }.current_dir(folder.path()).args(arguments).output().unwrap().status.success()
    );
    let [library, program] =
        ["scene.glb", "same.glb"].map(|name| std::fs::read(folder.path().join(name)).expect(name));
    assert!(library == program, "{} and {} bytes", library.len(), program.len());
    assert!(printed.contains(&format!("{} bytes", library.len())), "{printed}");
}

#[test]
fn the_example_trains_with_progress_and_writes_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let printed = run("train", folder.path(), &[&sample("dataset"), "out.ply", "200"]);
    let scene = read(folder.path().join("out.ply")).unwrap();
    assert!(printed.contains("Scene   100: "), "{printed}");
    assert!(printed.contains(&format!("{} triangles", scene.triangle_count())), "{printed}");
}

#[test]
fn the_example_draws_a_scene_soft_and_solid() {
    let folder = tempfile::tempdir().unwrap();
    run("draw", folder.path(), &[&sample("soups/trained.ply")]);
    let [soft, solid] = ["soft.png", "solid.png"]
        .map(|name| image::open(folder.path().join(name)).expect("a picture").to_rgb8());
    let first = *soft.get_pixel(0, 0);
    assert!(soft.pixels().any(|pixel| *pixel != first), "one colour");
    let apart: u64 = soft.iter().zip(solid.iter()).map(|(a, b)| u64::from(a.abs_diff(*b))).sum();
    let mean = apart as f64 / soft.len() as f64;
    assert!(mean < 16.0, "the same camera sees the same scene: {mean} of 255 apart");
}

#[test]
fn the_example_scores_a_scene_as_eval_does() {
    let folder = tempfile::tempdir().unwrap();
    let printed = run("score", folder.path(), &[&sample("soups/trained.ply"), &sample("dataset")]);
    let psnr: f64 = printed.split_whitespace().nth(1).expect("a figure").parse().expect("a number");
    assert!((20.0..60.0).contains(&psnr), "{printed}");
}

#[test]
fn the_example_makes_a_textured_surface_of_photos() {
    let folder = tempfile::tempdir().unwrap();
    let options = SyntheticOptions { views: 16, width: 64, ..SyntheticOptions::default() };
    std::fs::create_dir(folder.path().join("photos")).unwrap();
    trisplat_synthetic::write(&folder.path().join("photos"), &options).unwrap();
    let printed = run("surface", folder.path(), &["photos", "surface.glb", "4"]);
    let scene = read(folder.path().join("surface.glb")).unwrap();
    assert!(printed.contains(&format!("{} triangles", scene.triangle_count())), "{printed}");
    assert!(scene.triangle_count() <= 2000);
}
