//! `trisplat make`: everything in one command, and on again after a stop.

use super::train::dataset;
use super::{sample, stderr, trisplat};
use std::path::Path;
use std::process::{Command, Output, Stdio};
#[cfg(unix)]
use trisplat_fixtures::phone;
use trisplat_scene::image::RgbImage;

/// `make` with a number of steps, for the same bytes on every run.
const STEPS: [&str; 2] = ["--steps", "200"];

fn make(folder: &Path, more: &[&str]) -> Output {
    command(folder, "scene.glb", STEPS, more).output().unwrap()
}

fn command(folder: &Path, output: &str, effort: [&str; 2], more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command.current_dir(folder).arg("make").arg(dataset()).args(["-o", output, "--max-size", "60"]);
    command.args(effort).args(["--max-triangles", "500"]).args(more).stdin(Stdio::null());
    command
}

#[test]
fn budget_is_for_the_training_and_its_double_is_advised() {
    let folder = tempfile::tempdir().unwrap();
    let output = command(folder.path(), "scene.glb", ["--budget", "3s"], &[]).output().unwrap();
    let said = stderr(&output);
    assert!(output.status.success(), "{said}");
    assert!(said.contains("of the 3s of --budget, most are for training"), "{said}");
    assert!(said.contains("more time (--budget 6s --force)"), "{said}");
}

#[test]
fn make_of_a_missing_folder_says_only_that() {
    let folder = tempfile::tempdir().unwrap();
    let output = trisplat(&[&"make", &folder.path().join("photos"), &"-o", &"scene.glb"]);
    let said = stderr(&output);
    assert!(output.status.code() == Some(1) && said.lines().count() == 1, "{said}");
    assert!(said.contains("photos: does not exist"), "{said}");
}

#[cfg(unix)]
#[test]
fn make_killed_before_its_page_finishes_by_the_same_command() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // The page waits for a reader of this pipe.
    assert!(Command::new("mkfifo").arg(at("scene.html")).status().unwrap().success());
    let mut killed =
        command(folder.path(), "scene.glb", STEPS, &[]).stderr(Stdio::null()).spawn().unwrap();
    while !at("scene.glb").exists() && killed.try_wait().unwrap().is_none() {
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    std::fs::remove_file(at("scene.html")).unwrap();
    assert!(at("scene.glb").exists());
    let finished = make(folder.path(), &[]);
    assert!(finished.status.success(), "{}", stderr(&finished));
    assert!(std::fs::read_to_string(at("scene.html")).unwrap().contains("<html"));
    let refused = make(folder.path(), &[]);
    assert!(
        refused.status.code() == Some(1) && stderr(&refused).contains("--force"),
        "{}",
        stderr(&refused)
    );
}

#[cfg(unix)]
#[test]
fn make_killed_in_its_report_finishes_by_the_same_command() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let report = ["--report", "report.json"];
    // The report waits for a reader of this pipe.
    assert!(Command::new("mkfifo").arg(at("report.json")).status().unwrap().success());
    let mut killed =
        command(folder.path(), "scene.glb", STEPS, &report).stderr(Stdio::null()).spawn().unwrap();
    let began = std::time::Instant::now();
    while !at("scene.html").exists() && killed.try_wait().unwrap().is_none() {
        assert!(
            began.elapsed().as_secs() < 120,
            "it waits for the reader of the report before its work"
        );
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    // What scores the file comes between.
    std::thread::sleep(std::time::Duration::from_secs(2));
    killed.kill().unwrap();
    killed.wait().unwrap();
    std::fs::remove_file(at("report.json")).unwrap();
    // As a kill leaves it that comes while bytes are written.
    std::fs::write(at(".report.json.trisplat.tmp"), "{").unwrap();
    let finished = make(folder.path(), &report);
    assert!(finished.status.success(), "{}", stderr(&finished));
    let text = std::fs::read_to_string(at("report.json")).unwrap();
    assert!(
        serde_json::from_str::<serde_json::Value>(&text).unwrap()["outputs"].is_array(),
        "{text}"
    );
    let hidden = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(hidden.filter(|name| name.to_string_lossy().starts_with('.')).count(), 0);
    let refused = make(folder.path(), &report);
    assert!(
        refused.status.code() == Some(1) && stderr(&refused).contains("--force"),
        "{}",
        stderr(&refused)
    );
}

/// Four photos at quarters of a turn, `away` from the middle against their direction; of one color
/// unless `textured`.
fn four_photos(folder: &Path, away: f64, textured: bool) {
    std::fs::create_dir_all(folder).unwrap();
    let frame = |i: u32| {
        let rgb = (0..64 * 48)
            .map(|pixel| if textured { [40 * i as u8, pixel as u8, 90] } else { [90, 120, 30] });
        let photo = RgbImage { size: [64, 48].into(), rgb: rgb.collect(), alpha: None };
        photo.save_png(folder.join(format!("{i}.png"))).unwrap();
        let (sin, cos) = (f64::from(i) * std::f64::consts::FRAC_PI_2).sin_cos();
        serde_json::json!({ "file_path": format!("{i}.png"), "transform_matrix":
            [[cos, 0, sin, away * sin], [0, 1, 0, 0], [-sin, 0, cos, away * cos], [0, 0, 0, 1]] })
    };
    let frames: Vec<serde_json::Value> = (0..4).map(frame).collect();
    let text = serde_json::json!({ "fl_x": 60, "w": 64, "h": 48, "frames": frames }).to_string();
    std::fs::write(folder.join("transforms.json"), text).unwrap();
}

#[test]
fn photos_that_cannot_make_a_scene_are_refused_before_training() {
    let folder = tempfile::tempdir().unwrap();
    let make = |more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command.current_dir(folder.path()).args(["make", "photos", "-o", "a.glb", "--steps", "3"]);
        stderr(&command.args(more).stdin(Stdio::null()).output().unwrap())
    };
    let cases = [
        (2.0, false, "have one color each"),
        (0.0, true, "were taken from one place"),
        (-2.0, true, "4 of 4 photos show nothing that another photo shows too"),
    ];
    for (away, textured, wants) in cases {
        four_photos(&folder.path().join("photos"), away, textured);
        let said = make(&[]);
        assert!(
            said.contains("photos: ") && said.contains(wants) && said.contains("--anyway"),
            "{said}"
        );
        assert!(
            !folder.path().join("a.make/scene.ply").exists() && !said.contains("--force-dataset"),
            "{said}"
        );
        let said = make(&["--anyway"]);
        assert!(!said.contains(wants), "{said}");
        let _ = std::fs::remove_dir_all(folder.path().join("a.make"));
    }
    four_photos(&folder.path().join("photos"), 2.0, true);
    assert!(!make(&[]).contains("--anyway"));
}

#[test]
fn make_writes_a_file_and_a_page_and_trains_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let first = make(folder.path(), &["--report", "a.json"]);
    let said = stderr(&first);
    assert!(first.status.success(), "{said}");
    assert!(said.contains("capture    not needed: the photos have poses"), "{said}");
    assert!(
        said.contains("photos that training did not see") && said.contains("open scene.html"),
        "{said}"
    );
    // So few triangles are no good scene.
    let next =
        said.lines().find(|line| line.starts_with("next: ")).unwrap_or_else(|| panic!("{said}"));
    assert!(next.contains("more time (--steps 400 --force)"), "{next}");
    assert!(next.contains("more photos of what view_") && next.ends_with(" dB) shows"), "{next}");
    let glb = std::fs::read(at("scene.glb")).unwrap();
    assert!(
        glb.starts_with(b"glTF")
            && std::fs::read_to_string(at("scene.html")).unwrap().contains("<html")
    );
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(at("a.json")).unwrap()).unwrap();
    let stages = report["stages"].as_array().unwrap();
    let has = |name: &str| stages.iter().any(|stage| stage["name"] == name);
    let sh = stages.iter().find(|stage| stage["name"] == "sh").unwrap();
    assert!(sh["details"]["psnr_sh"].is_number(), "held-out photos judge harmonics: {sh}");
    assert!(has("capture") && has("train") && has("refit") && has("write"), "{stages:?}");
    assert_eq!(report["outputs"].as_array().unwrap().len(), 3, "{report}");
    // A capture with a subject gets a file of it, and the last lines say which file is for what.
    is_a_subject(&std::fs::read(at("scene.subject.glb")).unwrap(), glb.len());
    let line = |name: &str| {
        said.lines().find(|line| line.contains(&format!("wrote {name} "))).unwrap_or_default()
    };
    assert!(
        line("scene.subject.glb")
            .contains(": the subject alone, for viewers that frame the whole file"),
        "{said}"
    );
    assert!(
        line("scene.glb")
            .ends_with(": everything with its surroundings, to look around from within"),
        "{said}"
    );

    let place = |name: &str| said.find(&format!("wrote {name} ")).unwrap();
    assert!(place("scene.subject.glb") < place("scene.glb"), "viewers frame the first: {said}");

    // The page begins where the subject's file does.
    let [page, subject] = ["scene.html", "scene.subject.glb"].map(|name| {
        let scene = trisplat::read(at(name)).unwrap();
        let provenance = scene.provenance();
        (provenance.placement, provenance.viewpoint.unwrap())
    });
    let first = page.0.inverse().then(&subject.0).viewpoint_to_file(&page.1);
    let apart = (0..3).map(|i| {
        (first.eye[i] - subject.1.eye[i]).abs() + (first.target[i] - subject.1.target[i]).abs()
    });
    assert!(
        apart.sum::<f64>() < 1e-3 && (first.fov - subject.1.fov).abs() < 1e-9,
        "{first:?} {subject:?}"
    );

    // Nothing is replaced without --force.
    let refused = make(folder.path(), &[]);
    assert!(
        refused.status.code() == Some(1) && stderr(&refused).contains("--force"),
        "{}",
        stderr(&refused)
    );
    std::fs::rename(at("scene.glb"), at("other.glb")).unwrap();
    let refused = make(folder.path(), &[]);
    assert!(stderr(&refused).contains("scene.subject.glb"), "{}", stderr(&refused));
    let again = make(folder.path(), &["--force"]);
    assert!(
        again.status.success() && stderr(&again).contains("(done before)"),
        "{}",
        stderr(&again)
    );
    assert!(std::fs::read(at("scene.glb")).unwrap() == glb, "the same scene");

    // The subject alone is another bake of the same training.
    let subject = make(folder.path(), &["--force", "--crop", "subject"]);
    assert!(
        subject.status.success() && stderr(&subject).contains("(done before)"),
        "{}",
        stderr(&subject)
    );
    assert_eq!(nodes(&glb)["scene"], true, "{:?}", nodes(&glb));
    is_a_subject(&std::fs::read(at("scene.glb")).unwrap(), glb.len());
    let [file, page] = ["scene.glb", "scene.html"].map(|name| triangles(&at(name)));
    assert!(file == page && file > 0, "{file} {page}");
}

/// `make` with a number of steps and the name of a file.
fn steps(folder: &Path, steps: &str, output: &str, more: &[&str]) -> String {
    let mut command = command(folder, output, ["--steps", steps], more);
    let output = command.args(["--work", "work"]).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    stderr(&output)
}

/// The score of `make` is that of `eval`, and a later run with more effort knows it.
#[test]
fn the_score_is_that_of_eval_and_is_remembered() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let json = |name: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(at(name)).unwrap()).unwrap()
    };
    let said = steps(folder.path(), "200", "a.glb", &[]);
    let mut eval = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    eval.current_dir(folder.path()).args(["eval", "a.glb"]).arg(dataset());
    let eval = eval.args(["--max-size", "60", "--report", "eval.json"]).output().unwrap();
    assert!(eval.status.success(), "{}", stderr(&eval));
    let mean = |name: &str| json("eval.json")["steps"][0]["mean"][name].as_f64().unwrap();
    let psnr = mean("psnr");
    let scores =
        format!("{psnr:.1} dB / {:.3} SSIM / {:.3} FLIP on photos", mean("ssim"), mean("flip"));
    assert!(said.lines().any(|line| line.starts_with(&scores)), "{scores}: {said}");
    let remembered = |key: &str| json("work/training.json")[key].as_f64();
    assert!((remembered("psnr").unwrap() - psnr).abs() < 1e-9 && remembered("earlier").is_none());

    let said = steps(folder.path(), "220", "a.glb", &["--force"]);
    assert_eq!(remembered("earlier"), Some(psnr), "that of the run with less effort");
    let next =
        said.lines().find(|line| line.starts_with("next: ")).unwrap_or_else(|| panic!("{said}"));
    let helped = remembered("psnr").unwrap() >= psnr + 0.3;
    assert_eq!(next.contains("more time (--steps 440 --force)"), helped, "{next}");
}

/// What changes only the files needs no other training; phones show a texture.
#[test]
fn make_takes_the_options_of_the_bake() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    steps(folder.path(), "200", "a.usdz", &[]);
    let zip = std::fs::read(at("a.usdz")).unwrap();
    let holds = |name: &str| zip.windows(name.len()).any(|bytes| bytes == name.as_bytes());
    assert!(holds("inputs:file"), "a phone shows a texture");
    let options = ["--collision", "--lod", "0.5", "--target", "godot", "--scale-by", "1=2"];
    let said = steps(folder.path(), "200", "b.glb", &options);
    assert!(said.contains("(done before)"), "{said}");
    let glb = std::fs::read(at("b.glb")).unwrap();
    assert!(
        nodes(&glb)["collision-colonly"] == true && at("b.lod1.glb").exists(),
        "{:?}",
        nodes(&glb)
    );
    assert!(at("b.lod.tscn").exists() && at("b.glb.import").exists());
    steps(folder.path(), "200", "c.glb", &["--texture"]);
    assert!(triangles(&at("c.glb")) <= 500, "with the surroundings");
    assert!(document(&std::fs::read(at("c.glb")).unwrap())["images"].is_array());
    // Another device is another training.
    let said = steps(folder.path(), "200", "d.glb", &["--backend", "cpu"]);
    assert!(!said.contains("(done before)"), "{said}");
    // Harmonics that are asked for are trained.
    let has_harmonics = || {
        let scene = std::fs::read(at("work/scene.ply")).unwrap();
        scene.windows(7).take(2000).any(|bytes| bytes == b"f_rest_")
    };
    assert!(!has_harmonics());
    let said = steps(folder.path(), "200", "e.glb", &["--backend", "cpu", "--sh", "1"]);
    assert!(!said.contains("(done before)") && has_harmonics(), "{said}");
}

/// The document of a GLB.
fn document(glb: &[u8]) -> serde_json::Value {
    let length = u32::from_le_bytes(glb[12..16].try_into().unwrap()) as usize;
    serde_json::from_slice(&glb[20..20 + length]).unwrap()
}

/// The names of the nodes of a GLB, as keys.
fn nodes(glb: &[u8]) -> serde_json::Value {
    let document = document(glb);
    let names =
        document["nodes"].as_array().unwrap().iter().filter_map(|node| node["name"].as_str());
    names.map(|name| (name.to_owned(), true.into())).collect::<serde_json::Map<_, _>>().into()
}

fn triangles(path: &Path) -> u64 {
    let told = trisplat(&[&"info", &path, &"--json"]);
    serde_json::from_slice::<serde_json::Value>(&told.stdout).unwrap()["triangles"]
        .as_u64()
        .unwrap()
}

/// A file of a subject is smaller than that of the whole scene, has nothing behind it and no camera
/// beside it, which editors would frame too, and its origin is under it.
fn is_a_subject(glb: &[u8], whole: usize) {
    let names = nodes(glb);
    let document = document(glb);
    assert!(glb.len() < whole, "{} bytes of {whole}", glb.len());
    assert!(
        names["scene"] == true && names["backdrop"].is_null() && names["viewpoint"].is_null(),
        "{names}"
    );
    let at = &document["meshes"][0]["primitives"][0]["attributes"]["POSITION"];
    let accessor = &document["accessors"][at.as_u64().unwrap() as usize];
    let corner = |key: &str| [0, 1, 2].map(|axis| accessor[key][axis].as_f64().unwrap());
    let low = corner("min");
    let high = corner("max");
    let size = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    let is_middle = |axis: usize| (low[axis] + high[axis]).abs() < 0.05 * size[axis];
    // Some of the crate of the sample is below the floor that it stands on.
    assert!(is_middle(0) && is_middle(2), "{low:?} {high:?}");
    assert!(low[1] < 0.01 * size[1] && low[1] > -0.1 * size[1], "{low:?} {high:?}");
}

#[test]
fn bake_keeps_the_subject_alone() {
    let folder = tempfile::tempdir().unwrap();
    let bake = |name: &str, more: &[&str]| {
        let file = folder.path().join(name);
        let scene = sample("trained.ply");
        let more: Vec<&dyn AsRef<std::ffi::OsStr>> = more.iter().map(|word| word as _).collect();
        let bake: [&dyn AsRef<std::ffi::OsStr>; 6] =
            [&"bake", &scene, &"-o", &file, &"--preset", &"fast"];
        let output = trisplat(&[&bake[..], &more].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        std::fs::read(file).unwrap()
    };
    let whole = bake("whole.glb", &[]);
    let names = nodes(&whole);
    assert!(names["backdrop"] == true && names["viewpoint"] == true, "{names}");
    is_a_subject(&bake("subject.glb", &["--crop", "subject"]), whole.len());
}

#[test]
fn finding_poses_comes_on_top_of_the_budget() {
    let folder = tempfile::tempdir().unwrap();
    for photo in ["a.jpg", "b.jpg", "c.jpg"] {
        std::fs::write(folder.path().join(photo), b"no photo").unwrap();
    }
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command
        .current_dir(folder.path())
        .args(["make", "a.jpg", "b.jpg", "c.jpg", "-o", "a.glb", "--budget", "90s"]);
    let said = stderr(&command.stdin(Stdio::null()).output().unwrap());
    assert!(said.contains("camera poses are found first; the 90s of --budget"), "{said}");
}

#[test]
fn names_that_cannot_be_written_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    for (output, wants) in [
        ("-", "a file for an engine"),
        ("a.html", "a file for an engine"),
        ("no/a.glb", "a folder"),
    ] {
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command.current_dir(folder.path()).arg("make").arg(dataset()).args(["-o", output]);
        let output = command.stdin(Stdio::null()).output().unwrap();
        assert!(
            output.status.code() == Some(1) && stderr(&output).contains(wants),
            "{}",
            stderr(&output)
        );
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
}

#[cfg(unix)]
#[test]
fn exposure_is_equal_in_capture_training_and_bake() {
    let fake = super::capture::Fake::new();
    std::fs::remove_dir_all(fake.at("photos")).unwrap();
    let truth = phone::phone_sample(&fake.at("taken"));
    std::fs::rename(fake.at("taken/images"), fake.at("photos")).unwrap();
    // The limit of a million triangles gives the run time for trials; 60 steps never reach it.
    let said = fake.succeed(&[
        "make",
        "photos",
        "-o",
        "scene.glb",
        "--steps",
        "60",
        "--max-triangles",
        "1000000",
        "--sh",
        "0",
        "--report",
        "report.json",
    ]);
    let report: serde_json::Value =
        serde_json::from_slice(&std::fs::read(fake.at("report.json")).unwrap()).unwrap();
    let names: Vec<&str> = truth.iter().map(|photo| photo.name.as_str()).collect();
    let wanted = phone::true_spread(&truth, &names);
    for [stage, place] in [["verdict", ""], ["train", "/exposure"], ["exposure", ""]] {
        let stages = report["stages"].as_array().unwrap();
        let stage =
            stages.iter().find(|other| other["name"] == stage).unwrap_or_else(|| panic!("{stage}"));
        let found = stage["details"]
            .pointer(&format!("{place}/exposure"))
            .and_then(serde_json::Value::as_f64);
        assert!((found.unwrap() - wanted).abs() < phone::TENTH_OF_A_STOP, "{wanted} {stage}");
    }
    assert!(said.contains("% in exposure: lock the exposure"), "{said}");
}
