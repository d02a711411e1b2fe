//! `trisplat eval` and `trisplat render` as a user meets them.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_job::{EvalReport, RepresentationScore, SceneRenderer};
use trisplat_scene::{image::RgbImage, math::metric};

pub(super) fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("samples").join(name)
}

pub(super) fn trisplat(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_trisplat")).args(args).output().unwrap()
}

fn succeed(args: &[&str]) -> Output {
    let output = trisplat(args);
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

pub(super) fn fail(args: &[&str], parts: &[&str]) {
    let output = trisplat(args);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(!output.status.success(), "{args:?} succeeded");
    for part in parts {
        assert!(message.contains(part), "`{part}` is missing from: {message}");
    }
}

/// A small soft soup and the sample data set, as strings for the command line, and the folder of
/// the soup to write to.
pub(super) fn inputs() -> (String, String, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let text = |path: PathBuf| path.to_str().unwrap().to_owned();
    let soup = text(folder.path().join("soup.ply"));
    trisplat_fixtures::samples::studio(&soup, 800);
    (soup, text(sample("dataset")), folder)
}

/// Evaluates `file` on the sample's held-out photos: the report, and the folder the drawings are
/// in.
fn evaluated(file: &str, folder: &Path, name: &str, more: &[&str]) -> (EvalReport, PathBuf) {
    let renders = folder.join(name);
    let report = folder.join(name).with_extension("json");
    let [renders_text, report_text] = [&renders, &report].map(|p| p.to_str().unwrap());
    let dataset = sample("dataset");
    let fixed = ["eval", file, dataset.to_str().unwrap(), "--save-renders", renders_text];
    succeed(&[&fixed, &["--report", report_text][..], more].concat());
    (serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap(), renders)
}

/// Scores the written files once more, with our metrics and with a program that shares no code with
/// ours.
fn check_scores(step: &RepresentationScore, renders: &Path) {
    let dataset = Dataset::load(sample("dataset"), &DatasetOptions::default()).unwrap();
    assert_eq!(step.images.len(), 5);
    let mut sum = [0.0; 3];
    for (image, view) in step.images.iter().zip(dataset.test()) {
        assert_eq!(image.name, view.name);
        let drawn = RgbImage::load(&renders.join(&image.name)).unwrap();
        let photo = RgbImage::load(&view.photo.path).unwrap();
        let scores = [
            metric::psnr(&photo.rgb, &drawn.rgb, None),
            metric::ssim(photo.size, &photo.rgb, &drawn.rgb, None),
            metric::flip(photo.size, &photo.rgb, &drawn.rgb, None),
        ];
        assert_eq!(
            [image.score.psnr, image.score.ssim, image.score.flip],
            scores,
            "{}",
            image.name
        );
        sum = std::array::from_fn(|i| sum[i] + scores[i]);
    }
    for (mean, sum) in [step.mean.psnr, step.mean.ssim, step.mean.flip].iter().zip(sum) {
        assert!((mean - sum / 5.0).abs() < 1e-12);
    }
    independent(renders, &sample("dataset/images"), step);
}

#[test]
fn the_scores_are_those_of_the_files_written() {
    let (soup, _, folder) = inputs();
    let (report, renders) = evaluated(&soup, folder.path(), "all", &[]);
    assert_eq!((report.split.as_str(), report.ssaa), ("test", 4));
    let names: Vec<&str> = report.steps.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["soft", "solid", "file"]);
    for step in &report.steps {
        check_scores(step, &renders.join(&step.name));
    }
    let [soft, solid, file] = &report.steps[..] else { unreachable!() };
    assert!(soft.change.is_none() && file.bytes.is_some_and(|b| b > 1000));
    let change = [solid, file].map(|s| s.change.unwrap().psnr);
    assert!(file.mean != solid.mean, "it was rounded");
    assert_eq!(change, [solid.mean.psnr - soft.mean.psnr, file.mean.psnr - solid.mean.psnr]);

    // One step alone is that step.
    for step in [soft, solid] {
        let (alone, renders) = evaluated(&soup, folder.path(), &step.name, &["--as", &step.name]);
        assert_eq!(alone.steps.len(), 1);
        let scores = |step: &RepresentationScore| -> Vec<_> {
            step.images.iter().map(|image| (image.name.clone(), image.score)).collect()
        };
        assert_eq!(scores(&alone.steps[0]), scores(step));
        assert!(renders.join(&step.images[0].name).is_file());
    }
}

#[test]
fn eval_corrected_scores_ignore_the_exposure_of_a_photo() {
    let folder = tempfile::tempdir().unwrap();
    let scene = sample("soups/trained.ply");
    let scored = |dataset: &Path, name: &str| -> EvalReport {
        let report = folder.path().join(name);
        let [scene, dataset, text] = [&scene, dataset, &report].map(|p| p.to_str().unwrap());
        succeed(&["eval", scene, dataset, "--as", "solid", "-q", "--report", text]);
        serde_json::from_str(&std::fs::read_to_string(&report).unwrap()).unwrap()
    };
    let plain = scored(&sample("dataset"), "plain.json");
    // The same photos, darker and of another white balance.
    let other = folder.path().join("other");
    for part in ["images", "sparse/0"] {
        std::fs::create_dir_all(other.join(part)).unwrap();
        for entry in std::fs::read_dir(sample("dataset").join(part)).unwrap() {
            let path = entry.unwrap().path();
            std::fs::copy(&path, other.join(part).join(path.file_name().unwrap())).unwrap();
        }
    }
    std::fs::copy(sample("dataset/test.txt"), other.join("test.txt")).unwrap();
    for image in &plain.steps[0].images {
        let path = other.join("images").join(&image.name);
        let photo = RgbImage::load(&path).unwrap();
        let taken = |[r, g, b]: &[u8; 3]| {
            [(0.7, *r), (0.8, *g), (0.6, *b)].map(|(by, c)| (by * f64::from(c)) as u8)
        };
        let rgb = photo.rgb.iter().map(taken).collect();
        RgbImage { rgb, ..photo }.save_png(&path).unwrap();
    }
    let other = scored(&other, "other.json");
    let [plain, other] = [&plain, &other].map(|report| report.steps[0].mean);
    assert!(
        plain.psnr_corrected >= plain.psnr && plain.psnr_corrected < plain.psnr + 1.0,
        "{plain:?}"
    );
    assert!(other.psnr < plain.psnr - 5.0, "{other:?}");
    // Errors are smaller where all is darker: by the mean of the three gains, which is 3.1 dB.
    let gained = other.psnr_corrected - plain.psnr_corrected;
    assert!((2.5..3.7).contains(&gained), "{gained}");
    assert!((other.ssim_corrected - plain.ssim_corrected).abs() < 0.02, "{other:?} {plain:?}");
}

/// How alike the pictures of two folders are: the least PSNR.
fn alike(a: &Path, b: &Path) -> f64 {
    let mut least = f64::INFINITY;
    for entry in std::fs::read_dir(a).unwrap() {
        let name = entry.unwrap().file_name();
        let [one, other] = [a, b].map(|folder| RgbImage::load(&folder.join(&name)).unwrap());
        assert!(one.rgb.iter().any(|c| *c != one.rgb[0]), "{name:?} is empty");
        least = least.min(metric::psnr(&one.rgb, &other.rgb, None));
    }
    least
}

/// Puts the cameras of the sample's photos into the file of a soup: a bake fits it to as many small
/// pictures, not to large ones from chosen places, which takes most of a minute in all.
fn store_cameras(soup: &Path) {
    use trisplat_formats::{ReadOptions, ply::write_soup, read};
    let loaded = read(soup, &ReadOptions::with_degree(3)).unwrap();
    let trisplat_scene::Scene::Soup(scene) = loaded.scene else { panic!("the sample is a soup") };
    let dataset = Dataset::load(sample("dataset"), &DatasetOptions::default()).unwrap();
    let cameras: Vec<_> = dataset.train().map(|view| view.camera).collect();
    let mut file = std::fs::File::create(soup).unwrap();
    write_soup(&mut file, &scene, &loaded.provenance, &cameras).unwrap();
}

#[test]
fn a_file_is_drawn_like_the_scene_it_was_made_from() {
    let (soup, _, folder) = inputs();
    store_cameras(Path::new(&soup));
    let (whole, renders) = evaluated(&soup, folder.path(), "all", &["--ssaa", "2"]);
    let written = |name: &str, more: &[&str]| {
        let path = folder.path().join(name).to_str().unwrap().to_owned();
        succeed(&[&["bake", &soup, "-o", &path, "-q"], more].concat());
        let (report, own) =
            evaluated(&path, folder.path(), &format!("of_{name}"), &["--ssaa", "2"]);
        assert_eq!((report.steps.len(), report.steps[0].name.as_str()), (1, "solid"));
        assert_eq!(report.steps[0].triangles, whole.steps[1].triangles);
        check_scores(&report.steps[0], &own);
        own
    };
    // Turned, scaled and moved on the way out: the cameras still fit. What stays apart is how a
    // format rounds colours, and samples that lie on an edge to the last bit.
    let placed = ["--up", "z", "--set", "scale=3", "--set", "center=true"];
    let solid = renders.join("solid");
    let both = written("a.glb", &["--set", "sides=both"]);
    // Cameras alone keep the backs that they see, and held-out ones see a few more.
    let sides = alike(&solid, &both);
    assert!((30.0..100.0).contains(&sides), "sides are seen: {sides} dB");
    // OBJ and PLY say nothing of sides, so their triangles are fitted with both.
    for (name, wants) in [("b.glb", &solid), ("c.obj", &both), ("d.ply", &both)] {
        let like = alike(wants, &written(name, &placed));
        assert!(like > 45.0, "{name}: {like} dB");
    }
    for (name, more) in [
        ("e.glb", &["--target", "web", "--set", "compress=true"][..]),
        ("f.gltf", &["--target", "web", "--set", "compress=true", "--up", "x"]),
    ] {
        let like = alike(&renders.join("file"), &written(name, more));
        assert!(like > 40.0, "{name}: {like} dB");
    }
    assert!(alike(&renders.join("soft"), &renders.join("solid")) < 35.0, "soft is another picture");
}

/// The same pictures judged by a program that shares no code with ours.
fn independent(renders: &Path, photos: &Path, ours: &RepresentationScore) {
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/../shared/metrics/compare.py");
    let json = renders.with_extension("compare.json");
    let mut python = Command::new("python3");
    python.arg(script).arg(renders).arg(photos).arg("--json").arg(&json);
    if !python.output().is_ok_and(|o| o.status.success()) {
        trisplat_fixtures::skip::skipped(
            "no ../shared/metrics/compare.py, or no Python with numpy, pillow and scipy",
        );
        return;
    }
    let theirs: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(json).unwrap()).unwrap();
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
        let mut names: Vec<PathBuf> =
            std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().path()).collect();
        names.sort();
        names.iter().map(|path| RgbImage::load(path).unwrap()).collect::<Vec<_>>()
    };
    let color = draw("color", &["--dataset", &dataset]);
    assert_eq!(color.len(), 5, "the held-out photos");
    assert_eq!(color[0].size.to_array(), [64, 48]);
    assert_eq!(color, draw("again", &["--dataset", &dataset, "--threads", "1"]));
    let mut kinds = vec![color];
    for show in ["depth", "normal"] {
        let pictures = draw(show, &["--dataset", &dataset, "--show", show]);
        assert!(
            pictures.iter().all(|p| p.rgb.iter().any(|c| *c != p.rgb[0])),
            "{show} is of one colour"
        );
        assert!(!kinds.contains(&pictures), "{show} is another kind's picture");
        kinds.push(pictures);
    }
    assert_eq!(draw("train", &["--dataset", &dataset, "--split", "train"]).len(), 35);
    assert_eq!(draw("circle", &["--dataset", &dataset, "--orbit", "3"]).len(), 3);
    for (name, more) in [
        ("solid", &["--as", "solid"][..]),
        ("solid depth", &["--as", "solid", "--show", "depth"]),
        ("wires", &["--as", "solid", "--show", "wires"]),
    ] {
        let pictures = draw(name, &[&["--dataset", &dataset][..], more].concat());
        assert!(
            pictures.iter().all(|p| p.rgb.iter().any(|c| *c != p.rgb[0])),
            "{name} is of one colour"
        );
        assert!(!kinds.contains(&pictures), "{name} is another kind's picture");
        kinds.push(pictures);
    }
    let alone = draw("alone", &["--orbit", "2", "--width", "40"]);
    assert_eq!((alone.len(), alone[0].size.to_array()), (2, [40, 30]));
}

#[test]
fn what_cannot_be_drawn_says_why() {
    let (soup, dataset, folder) = inputs();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let mesh = path("mesh.glb");
    let out = path("out");
    let report = path("eval.json");
    succeed(&["bake", &soup, "-o", &mesh, "-q"]);
    fail(
        &["eval", &mesh, &dataset, "--as", "soft"],
        &["mesh.glb", "mesh", "trained soup", "--as solid"],
    );
    fail(
        &["render", &mesh, "-o", &out, "--orbit", "1", "--as", "soft"],
        &["mesh.glb", "trained soup"],
    );
    fail(&["eval", &mesh, &dataset, "--ssaa", "3"], &["--ssaa", "1, 2 or 4"]);
    let wires = ["--orbit", "1", "--show", "wires"];
    fail(
        &[&["render", &soup, "-o", &out][..], &wires].concat(),
        &["--show", "only a baked file has wires"],
    );
    let large = ["--orbit", "1", "--width", "16384", "--ssaa", "4"];
    fail(&[&["render", &mesh, "-o", &out][..], &large].concat(), &["--limit camera_pixels="]);
    let large = [&large[..], &["--limit", "camera_pixels=300000000"]].concat();
    fail(&[&["render", &mesh, "-o", &out][..], &large].concat(), &["samples", "8192 px"]);
    fail(&["eval", &soup, &mesh], &["mesh.glb", "not a data set"]);
    fail(&["eval", &soup, &dataset, "--test-every", "0"], &["--split", "train or all"]);
    fail(&["render", &soup, "-o", &out], &["--dataset"]);
    succeed(&["render", &soup, "-o", &out, "--orbit", "1", "--width", "8"]);
    fail(
        &["render", &soup, "-o", &out, "--orbit", "1", "--width", "8"],
        &["orbit_0000.png", "--force"],
    );
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
        "0.313 px mean error over 8,833 observations",
    ] {
        assert!(table.contains(part), "`{part}` is missing from:\n{table}");
    }
    let json = trisplat(&["info", "--json", &dataset]).stdout;
    let description: trisplat_dataset::Description = serde_json::from_slice(&json).unwrap();
    assert_eq!((description.train, description.test, description.points), (35, 5, 1500));
    fail(&["info", env!("CARGO_MANIFEST_DIR")], &["no posed photos", "COLMAP"]);
}

#[test]
fn a_made_data_set_can_be_read() {
    let (_, _, folder) = inputs();
    let out = folder.path().join("made").to_str().unwrap().to_owned();
    trisplat_fixtures::samples::photos(&out, [3, 16, 20], 0);
    let dataset = Dataset::load(Path::new(&out), &DatasetOptions::default()).unwrap();
    assert_eq!((dataset.views.len(), dataset.points.len(), dataset.test().count()), (3, 20, 1));
    assert!(dataset.views.iter().all(|v| v.photo.decode().is_ok()));
}

#[test]
fn a_soup_of_a_far_world_is_drawn_where_its_file_says() {
    use trisplat_formats::{self as formats, ReadOptions};
    use trisplat_scene::{Placement, UpAxis};
    let loaded = formats::read(&sample("soups/studio.ply"), &ReadOptions::with_degree(3)).unwrap();
    let trisplat_scene::Scene::Soup(soup) = loaded.scene else { panic!("the sample is a soup") };
    let mut dataset = Dataset::load(sample("dataset"), &DatasetOptions::default()).unwrap();
    let camera = dataset.views[0].camera;
    let soft = |soup: &trisplat_scene::Soup, placement: &Placement, dataset: &Dataset| {
        SceneRenderer::soft(soup.clone(), placement, Some(dataset), [0.0; 3]).color(&camera)
    };
    let near = soft(&soup, &Placement::IDENTITY, &dataset);
    // Survey coordinates: the cameras were read relative to a point, the soup was trained there.
    let far = [4.5e6, -2e5, 1.25e6];
    dataset.origin = far.into();
    let moved = Placement { center: far, ..Placement::IDENTITY };
    assert_eq!(soft(&soup, &moved, &dataset), near);
    // The same soup in a file that was turned Y up.
    let turned = Placement { up: UpAxis::NegY.into(), rotate: 0.0, scale: 2.0, center: far };
    let mut file = soup;
    for corner in file.vertices.iter_mut().flatten() {
        *corner = 2.0 * glam::Vec3::new(corner.x, -corner.y, -corner.z);
    }
    assert_eq!(soft(&file, &turned, &dataset), near);
}

/// A rule that decides by photos must not cost what the bake has without it.
#[test]
fn defaults_lose_nothing_that_their_absence_keeps() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let [scene, photos] = ["soups/trained.ply", "dataset"].map(sample);
    let [scene, photos] = [&scene, &photos].map(|path| path.to_str().unwrap());
    let baked = |name: &str, change: &[&str]| {
        let file = path(&format!("{name}.glb"));
        succeed(&[&["bake", scene, "-o", &file, "--dataset", photos][..], change].concat());
        let (report, _) = evaluated(&file, folder.path(), name, &[]);
        let step = report.steps.into_iter().next_back().unwrap();
        (step.mean.psnr, step.mean.ssim, step.beside.unwrap().unsupported)
    };
    let default = baked("default", &[]);
    for (name, off) in [
        ("sides", "sides=both"),
        ("exposure", "exposure=off"),
        ("refit", "refit=off"),
        ("unseen", "keep_unseen=true"),
    ] {
        let without = baked(name, &["--set", off]);
        let case = format!("{default:?}, with {off} {without:?}");
        assert!(default.0 > without.0 - 0.1 && default.1 > without.1 - 0.003, "{case}");
        assert!(default.2 < without.2 + 0.005, "{case}");
    }
}
