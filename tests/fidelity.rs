//! `trisplat eval` and `trisplat render` as a user meets them.

#![allow(clippy::print_stderr, reason = "a skipped test says so")]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use trisplat::bench::fidelity::Fidelity;
use trisplat::dataset::{Dataset, DatasetOptions};
use trisplat::image::Pixels;
use trisplat::math::metric;

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name)
}

fn trisplat(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trisplat")).args(args).output().unwrap()
}

fn succeed(args: &[&str]) {
    let output = trisplat(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
}

fn fail(args: &[&str], parts: &[&str]) {
    let output = trisplat(args);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "{args:?} succeeded");
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing from: {message}");
    }
}

/// A soup file and the sample data set, as strings for the command line, and a folder to write to.
fn inputs() -> (String, String, tempfile::TempDir) {
    let text = |path: PathBuf| path.to_str().unwrap().to_owned();
    (text(sample("soups/studio.ply")), text(sample("dataset")), tempfile::tempdir().unwrap())
}

#[test]
fn the_scores_are_those_of_the_files_written() {
    let (soup, dataset, folder) = inputs();
    let [renders, report] =
        ["renders", "eval.json"].map(|n| folder.path().join(n).to_str().unwrap().to_owned());
    succeed(&["eval", &soup, &dataset, "--save-renders", &renders, "--report", &report]);
    let fidelity: Fidelity = serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap();
    let loaded = Dataset::load(Path::new(&dataset), &DatasetOptions::default()).unwrap();
    assert_eq!((fidelity.images.len(), fidelity.split.as_str()), (5, "test"));
    let mut sum = [0.0; 3];
    for (image, view) in fidelity.images.iter().zip(loaded.test()) {
        assert_eq!(image.name, view.name);
        let drawn = Pixels::load(&Path::new(&renders).join(&image.name)).unwrap();
        let photo = Pixels::load(&view.photo.path).unwrap();
        let scores = [
            metric::psnr(&photo.rgb, &drawn.rgb, None),
            metric::ssim(photo.size, &photo.rgb, &drawn.rgb, None),
            metric::flip(photo.size, &photo.rgb, &drawn.rgb, None),
        ];
        assert_eq!([image.score.psnr, image.score.ssim, image.score.flip], scores, "{}", image.name);
        sum = std::array::from_fn(|i| sum[i] + scores[i]);
    }
    let mean = [fidelity.mean.psnr, fidelity.mean.ssim, fidelity.mean.flip];
    for (mean, sum) in mean.iter().zip(sum) {
        assert!((mean - sum / 5.0).abs() < 1e-12);
    }
    independent(&renders, &sample("dataset/images"), &fidelity);
}

/// The same pictures judged by a program that shares no code with ours.
fn independent(renders: &str, photos: &Path, ours: &Fidelity) {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/metrics/compare.py");
    let json = Path::new(renders).with_extension("json");
    let mut python = Command::new("python3");
    python.arg(script).arg(renders).arg(photos).arg("--json").arg(&json);
    if !python.output().is_ok_and(|o| o.status.success()) {
        eprintln!("SKIPPED (no ../shared/metrics/compare.py, or no Python with numpy, pillow and scipy)");
        return;
    }
    let theirs: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
    let theirs = theirs["images"].as_array().unwrap();
    assert_eq!(theirs.len(), ours.images.len());
    for (theirs, ours) in theirs.iter().zip(&ours.images) {
        assert_eq!(theirs["name"].as_str().unwrap(), ours.name.trim_end_matches(".png"));
        let off = |key: &str, own: f64| (theirs[key].as_f64().unwrap() - own).abs();
        assert!(
            off("psnr", ours.score.psnr) < 1e-6 && off("ssim", ours.score.ssim) < 1e-9,
            "{theirs} {ours:?}"
        );
    }
}

#[test]
fn pictures_are_of_the_asked_kind_and_the_same_every_time() {
    let (soup, dataset, folder) = inputs();
    let draw = |name: &str, more: &[&str]| {
        let out = folder.path().join(name).to_str().unwrap().to_owned();
        let all = [&["render", &soup, "-o", &out, "--max-size", "64"], more].concat();
        succeed(&all);
        let mut names: Vec<PathBuf> = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().path()).collect();
        names.sort();
        names.iter().map(|path| Pixels::load(path).unwrap()).collect::<Vec<_>>()
    };
    let color = draw("color", &["--dataset", &dataset]);
    assert_eq!(color.len(), 5, "the held-out photos");
    assert_eq!(color[0].size.to_array(), [64, 48]);
    assert_eq!(color, draw("again", &["--dataset", &dataset, "--threads", "1"]));
    let mut kinds = vec![color];
    for show in ["depth", "normal", "contributions", "random-subset"] {
        let pictures = draw(show, &["--dataset", &dataset, "--show", show]);
        assert!(pictures.iter().all(|p| p.rgb.iter().any(|c| *c != p.rgb[0])), "{show} is of one colour");
        assert!(!kinds.contains(&pictures), "{show} is another kind's picture");
        kinds.push(pictures);
    }
    assert_eq!(draw("train", &["--dataset", &dataset, "--split", "train"]).len(), 35);
    assert_eq!(draw("circle", &["--dataset", &dataset, "--orbit", "3"]).len(), 3);
    let alone = draw("alone", &["--orbit", "2", "--width", "40"]);
    assert_eq!((alone.len(), alone[0].size.to_array()), (2, [40, 30]));
}

#[test]
fn what_cannot_be_drawn_says_why() {
    let (soup, dataset, folder) = inputs();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (mesh, out, report) = (path("mesh.glb"), path("out"), path("eval.json"));
    succeed(&["bake", &soup, "-o", &mesh, "-q"]);
    fail(&["eval", &mesh, &dataset], &["mesh.glb", "mesh", "trained soup"]);
    fail(&["eval", &soup, &mesh], &["mesh.glb", "not a data set"]);
    fail(&["eval", &soup, &dataset, "--test-every", "0"], &["--split", "train or all"]);
    fail(&["render", &soup, "-o", &out], &["--dataset"]);
    fail(&["render", &soup, "-o", &out, "--orbit", "1", "--share", "2"], &["--share", "from 0 to 1"]);
    succeed(&["render", &soup, "-o", &out, "--orbit", "1", "--width", "8"]);
    fail(&["render", &soup, "-o", &out, "--orbit", "1", "--width", "8"], &["orbit_0000.png", "--force"]);
    succeed(&["render", &soup, "-o", &out, "--orbit", "1", "--width", "8", "--force"]);
    std::fs::write(&report, "mine").unwrap();
    fail(&["eval", &soup, &dataset, "--report", &report], &["eval.json", "--force"]);
    assert_eq!(std::fs::read_to_string(&report).unwrap(), "mine");
}

#[test]
fn info_prints_a_table_of_a_data_set() {
    let (_, dataset, _folder) = inputs();
    let output = trisplat(&["info", &dataset]);
    let table = String::from_utf8(output.stdout).unwrap();
    for part in [
        "COLMAP model (text)",
        "40: 35 to train on, 5 held out",
        "160x120",
        "1,500",
        "0.313 px mean error over 8,833 sightings",
    ] {
        assert!(table.contains(part), "`{part}` is missing from:\n{table}");
    }
    let json = trisplat(&["info", "--json", &dataset]).stdout;
    let description: trisplat::dataset::Description = serde_json::from_slice(&json).unwrap();
    assert_eq!((description.train, description.test, description.points), (35, 5, 1500));
    fail(&["info", env!("CARGO_MANIFEST_DIR")], &["no posed photos", "COLMAP"]);
}

#[test]
fn a_made_data_set_can_be_read() {
    let (_, _, folder) = inputs();
    let out = folder.path().join("made").to_str().unwrap().to_owned();
    let make = ["sample", "dataset", "-o", &out, "--views", "3", "--width", "16", "--points", "20"];
    succeed(&make);
    let dataset = Dataset::load(Path::new(&out), &DatasetOptions::default()).unwrap();
    assert_eq!((dataset.views.len(), dataset.points.len(), dataset.test().count()), (3, 20, 1));
    assert!(dataset.views.iter().all(|v| v.photo.decode().is_ok()));
    fail(&make, &["--force", "made"]);
    succeed(&[make.as_slice(), &["--force"]].concat());
}

#[test]
fn a_soup_of_a_far_world_is_drawn_where_its_file_says() {
    use trisplat::asset::{Placement, UpAxis};
    use trisplat::bench::fidelity::Painter;
    use trisplat::formats::{self, ReadOptions};
    let loaded = formats::read(&sample("soups/studio.ply"), &ReadOptions { sh_degree: 3 }).unwrap();
    let (soup, _) = trisplat::bench::fidelity::soup_of(Path::new("studio.ply"), loaded).unwrap();
    let mut dataset = Dataset::load(&sample("dataset"), &DatasetOptions::default()).unwrap();
    let camera = dataset.views[0].camera;
    let near = Painter::new(soup.clone(), &Placement::IDENTITY, &dataset, [0.0; 3]).color(&camera);
    // Survey coordinates: the cameras were read relative to a point, the soup was trained there.
    let far = [4.5e6, -2e5, 1.25e6];
    dataset.origin = far.into();
    let moved = Placement { center: far, ..Placement::IDENTITY };
    assert_eq!(Painter::new(soup.clone(), &moved, &dataset, [0.0; 3]).color(&camera), near);
    // The same soup in a file that was turned Y up.
    let turned = Placement { up: UpAxis::NegY, scale: 2.0, center: far };
    let mut file = soup;
    for corner in file.vertices.iter_mut().flatten() {
        *corner = 2.0 * glam::Vec3::new(corner.x, -corner.y, -corner.z);
    }
    assert_eq!(Painter::new(file, &turned, &dataset, [0.0; 3]).color(&camera), near);
}
