//! The programs in `examples` do what they say.

use std::path::{Path, PathBuf};
use std::process::Command;
use trisplat::{ReadOptions, read};

/// Runs an example in `folder` and returns what it prints.
fn run(name: &str, folder: &Path, arguments: &[&str]) -> String {
    let program = PathBuf::from(env!("CARGO_BIN_EXE_trisplat")).with_file_name("examples").join(name);
    let program = program.with_extension(std::env::consts::EXE_EXTENSION);
    assert!(program.is_file(), "{} is not built: cargo build --examples", program.display());
    let done = Command::new(program).current_dir(folder).args(arguments).output().expect("it starts");
    assert!(done.status.success(), "{name}: {}", String::from_utf8_lossy(&done.stderr));
    String::from_utf8(done.stdout).expect("it prints text")
}

#[test]
fn bake_bytes_drops_the_faint_and_makes_a_glb() {
    let folder = tempfile::tempdir().unwrap();
    let printed = run("bake_bytes", folder.path(), &[]);
    let pruned = printed.lines().find(|line| line.starts_with("prune")).expect("the stage is listed");
    assert!(pruned.contains("64 -> ") && !pruned.contains("-> 64 "), "{printed}");
    assert!(printed.contains("bytes of GLB"), "{printed}");
}

#[test]
fn train_and_bake_writes_a_glb_that_reads_back() {
    let folder = tempfile::tempdir().unwrap();
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset");
    let printed = run("train_and_bake", folder.path(), &[samples.to_str().unwrap(), "out.glb", "200"]);
    let scene = read(&folder.path().join("out.glb"), &ReadOptions::default()).unwrap().scene;
    assert!(
        scene.triangle_count() > 100 && printed.contains(&format!("{} triangles", scene.triangle_count())),
        "{printed}"
    );
}

#[test]
fn render_views_draws_every_tenth_camera_twice() {
    let folder = tempfile::tempdir().unwrap();
    let soup = Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/soups/trained.ply");
    run("render_views", folder.path(), &[soup.to_str().unwrap(), "views"]);
    let mut names: Vec<_> =
        std::fs::read_dir(folder.path().join("views")).unwrap().map(|f| f.unwrap().file_name()).collect();
    names.sort();
    let cameras = read(&soup, &ReadOptions::default()).unwrap().cameras.len();
    assert_eq!(names.len(), 2 * cameras.div_ceil(10));
    for kind in ["soft", "solid"] {
        let picture = image::open(folder.path().join(format!("views/000_{kind}.png"))).unwrap().to_rgb8();
        let first = *picture.get_pixel(0, 0);
        assert!(picture.pixels().any(|p| *p != first), "{kind} is one colour");
    }
}
