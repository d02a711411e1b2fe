//! The library makes the bytes of the program: whatever is decided between options and files is
//! decided in the library.

use super::train::{dataset, succeed, train};
use super::train_teacher::{SHORT, few_photos, read, train_few};
use super::{sample, trisplat};
use serde_json::json;
use std::ops::ControlFlow::{self, Continue};
use std::path::Path;
use std::process::Command;
use trisplat::{BakeJob, BakeOptions, BakePreset, Dataset, DatasetOptions, TrainJob, TrainOptions};
use trisplat_dataset::exposure::{ExposureEvidence, ExposureUse};
use trisplat_fixtures::phone::phone_sample;
use trisplat_job::{BakeInput, Baked, Event, TeacherSource, TrainPart, TrainResult};
use trisplat_scene::{Budget, Seconds, layered::Layers};
use trisplat_train::Trained;

/// What the flags of [`train`] ask for; `given` are flags of the training.
fn job(given: serde_json::Value) -> TrainJob {
    let dataset_options = DatasetOptions {
        max_size: Some(80),
        background: "#203040".parse().unwrap(),
        ..DatasetOptions::default()
    };
    let layers =
        Layers::default().with_settings(&["densify.every=10".to_owned()]).with_options(given);
    let mut job =
        TrainJob::new(Dataset::load(dataset(), &dataset_options).unwrap(), TrainOptions::default());
    job.teacher = Some(TeacherSource::Off);
    job.dataset_options = dataset_options;
    job.options = layers.resolve(TrainOptions::preset).unwrap();
    job
}

fn bytes(folder: &Path, trained: &Trained) -> Vec<u8> {
    let path = folder.join("library.ply");
    trained.save(&path).unwrap();
    std::fs::read(path).unwrap()
}

#[test]
fn a_training_by_default() {
    let folder = tempfile::tempdir().unwrap();
    succeed(&mut train(folder.path(), &["-o", "a.ply"]));
    let done = job(json!({ "steps": 30 })).run(&mut |_| Continue(())).unwrap();
    assert!(bytes(folder.path(), &done.trained) == read(folder.path(), "a.ply"));
}

#[test]
fn a_training_with_and_without_a_teacher() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    few_photos(folder);
    succeed(&mut train_few(folder, "a.ply", &[&SHORT as &[&str], &["--teacher", "auto"]].concat()));
    succeed(&mut train_few(folder, "b.ply", &SHORT));
    let photos = Dataset::load(folder.join("photos"), &DatasetOptions::default()).unwrap();
    let options = TrainOptions { steps: 30, max_triangles: 100, ..TrainOptions::default() };
    let scene = read(folder, "a.ply");
    let by_default = trisplat::train(&photos, &options, &mut |_| Continue(())).unwrap();
    assert!(scene != read(folder, "b.ply") && bytes(folder, &by_default) == read(folder, "b.ply"));
    let mut teacher = None;
    let mut observer = |event: Event<'_>| {
        if let Event::Teacher(trained) = event {
            teacher = Some(trained.clone());
        }
        Continue(())
    };
    let mut job = TrainJob::new(photos, options);
    job.teacher = Some(TeacherSource::Auto);
    let TrainResult { trained, report, .. } = job.run(&mut observer).unwrap();
    assert!(bytes(folder, &trained) == scene);
    assert!(bytes(folder, &teacher.unwrap()) == read(folder, "a.teacher.ply"));
    assert_eq!(
        report.stages.iter().map(|stage| &stage.name).collect::<Vec<_>>(),
        ["evidence", "teacher", "train"]
    );
}

/// Counts the short trainings, and stops the first of them or the run after them.
#[derive(Default)]
struct Trials {
    trainings: usize,
    said: Option<ExposureEvidence>,
    stop: bool,
}

impl Trials {
    fn tell(&mut self, event: &Event<'_>) -> ControlFlow<()> {
        match event {
            Event::TrainingStarted(begins) if begins.part == TrainPart::Trial => {
                self.trainings += 1
            }
            Event::TrainingStarted(_) => return ControlFlow::Break(()),
            Event::Exposure(evidence) => self.said = Some(**evidence),
            Event::Step { .. } if self.stop => return ControlFlow::Break(()),
            _ => {}
        }
        Continue(())
    }
}

/// A training on the sample as a phone takes it, which stops where the run itself begins.
fn of_phone(folder: &Path, change: impl FnOnce(&mut TrainJob)) -> (Trials, String) {
    let how = DatasetOptions { max_size: Some(96), ..DatasetOptions::default() };
    let mut job = TrainJob::new(Dataset::load(folder, &how).unwrap(), TrainOptions::default());
    let mut observer = Trials::default();
    change(&mut job);
    let error = job.run(&mut |event| observer.tell(&event)).unwrap_err().to_string();
    (observer, error)
}

#[test]
fn exposure_is_judged_by_left_out_photos_where_a_run_has_time() {
    let folder = tempfile::tempdir().unwrap();
    phone_sample(folder.path());
    let (judged, _) = of_phone(folder.path(), |_| ());
    let evidence = judged.said.unwrap();
    assert!(evidence.photos >= 12 && judged.trainings >= 1, "{evidence:?}");
    // The share for a slope of 0.87 less its standard error.
    assert!(evidence.strengths.gain > 0.4, "{evidence:?}");
    let (again, _) = of_phone(folder.path(), |job| job.budget = Some(Budget::cpu(Seconds(120.0))));
    assert_eq!(again.said, Some(evidence), "a budget changes nothing but whether there is time");
    let not_judged: [fn(&mut TrainJob); 4] = [
        |job| job.budget = Some(Budget::cpu(Seconds(2.0))),
        |job| job.options.options.steps = 100,
        |job| job.outputs.max_cpu_secs = 1e6,
        |job| job.options.options.exposure = ExposureUse::On,
    ];
    for change in not_judged {
        let (trials, _) = of_phone(folder.path(), change);
        assert!(trials.trainings == 0 && trials.said.is_none());
    }
}

#[test]
fn train_stopped_early_says_that_nothing_was_written() {
    let folder = tempfile::tempdir().unwrap();
    phone_sample(folder.path());
    let how = DatasetOptions { max_size: Some(96), ..DatasetOptions::default() };
    let job = TrainJob::new(Dataset::load(folder.path(), &how).unwrap(), TrainOptions::default());
    let mut observer = Trials { stop: true, ..Trials::default() };
    let error = job.run(&mut |event| observer.tell(&event)).unwrap_err().to_string();
    assert!(
        error.contains("leaves some photos out") && error.contains("nothing was written"),
        "{error}"
    );
    assert_eq!((observer.trainings, observer.said), (1, None));
}

/// Timings choose the numbers of a budget, so the program is given those that the library chose.
#[test]
fn a_training_with_a_budget() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = job(json!({}));
    job.budget = Some(Budget::cpu(Seconds(2.0)));
    let done = job.run(&mut |_| Continue(())).unwrap();
    let repeat = done.trained.budget().unwrap().repeat.replace('"', "");
    let flags: Vec<&str> = repeat.split(' ').chain(["-o", "a.ply"]).collect();
    succeed(&mut train(folder.path(), &flags));
    assert!(bytes(folder.path(), &done.trained) == read(folder.path(), "a.ply"), "{repeat}");
}

fn baked(folder: &Path, input: &Path, flags: &[&str]) -> Vec<u8> {
    let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
    command
        .current_dir(folder)
        .arg("bake")
        .arg(input)
        .args(["-o", "program.glb", "--force"])
        .args(flags);
    succeed(&mut command);
    read(folder, "program.glb")
}

fn library(folder: &Path, job: BakeJob) -> (Vec<u8>, Baked) {
    let done = job.save(&folder.join("library.glb"), &mut |_| Continue(())).unwrap();
    (read(folder, "library.glb"), done)
}

fn bake(input: &Path) -> BakeJob {
    BakeJob::new([BakeInput::File(input.to_owned())], BakeOptions::default())
}

#[test]
fn a_bake_by_default_and_with_photos() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let trained = sample("trained.ply");
    assert!(library(folder, bake(&trained)).0 == baked(folder, &trained, &[]));
    let mut with_photos = bake(&trained);
    with_photos.options = BakeOptions::preset(BakePreset::Fast);
    with_photos.photos = Some(Dataset::load(dataset(), &DatasetOptions::default()).unwrap());
    let photos = dataset().display().to_string();
    let program =
        baked(folder, &trained, &["--preset", "fast", "--dataset", &photos, "--max-bytes", "60kB"]);
    with_photos.max_bytes = Some(60_000);
    assert!(library(folder, with_photos).0 == program);
}

/// A soft scene of few triangles.
fn soft(folder: &Path) -> std::path::PathBuf {
    few_photos(folder);
    succeed(&mut train_few(
        folder,
        "soft.ply",
        &[&SHORT as &[&str], &["--preset", "outdoor"]].concat(),
    ));
    folder.join("soft.ply")
}

#[test]
fn a_bake_of_a_hardened_scene() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let soft = soft(folder);
    let mut job = bake(&soft);
    job.harden = Some(40);
    let (bytes, done) = library(folder, job);
    assert!(bytes == baked(folder, &soft, &["--harden=40"]));
    let first = done.report.stages[..2].iter().map(|stage| stage.name.as_str());
    assert!(
        first.eq(["background", "train"]),
        "the background is found before the training draws pictures"
    );
}

/// What the output options ask for is written.
#[test]
fn a_target_in_the_options_is_the_target_of_the_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = bake(&sample("trained.ply"));
    job.options.output.target = trisplat_formats::OutputTarget::Godot;
    job.options.reshape.reshape = trisplat_bake::ReshapeWhen::Off;
    let out = folder.path().join("a.glb");
    job.save(&out, &mut |_| Continue(())).unwrap();
    assert!(folder.path().join("a.glb.import").is_file());
    let program = folder.path().join("b.glb");
    let output =
        trisplat(&[&"bake", &sample("trained.ply"), &"-o", &program, &"--target", &"godot"]);
    assert!(output.status.success());
    assert!(std::fs::read(out).unwrap() == std::fs::read(program).unwrap());
}

/// The lines of the crate's documentation, on samples.
#[test]
fn face_runs_as_documented() {
    use trisplat::{Camera, Format, Renderer};
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let photos = Dataset::load(dataset(), &DatasetOptions::default()).unwrap();
    let options = TrainOptions::default().steps(500).max_triangles(20_000).seed(1);
    assert_eq!((options.steps, options.max_triangles, options.seed), (500, 20_000, 1));

    let soup = trisplat::read(sample("studio.ply")).unwrap();
    let baked = trisplat::bake(soup, &BakeOptions::fast()).unwrap();
    baked.write(at("mesh.glb")).unwrap();
    let scene = trisplat::read(at("mesh.glb")).unwrap();
    let bounds = scene.bounds();
    let origin = bounds.center() + glam::Vec3::Y * 2.0 * bounds.radius();
    let direction = baked.asset.mesh.centroid(0) - origin;
    let hit: Option<trisplat::Hit> = baked.raycast(origin, direction);
    assert!(hit.is_some() && scene.raycast(origin, direction).is_some());
    let renderer = Renderer::new(&scene).unwrap();
    for camera in Camera::orbit(&bounds, 3, 0.8, [64, 48]) {
        let picture = renderer.draw(&camera).unwrap();
        assert!(picture.rgb.iter().any(|pixel| *pixel != [0; 3]));
    }
    trisplat::write(&scene, at("copy.ply")).unwrap();
    let copy = trisplat::read(at("copy.ply")).unwrap();
    assert_eq!(copy.triangle_count(), scene.triangle_count());

    let scores: trisplat::Scores = trisplat::score(&baked, &photos).unwrap();
    assert!(scores.psnr.is_finite());
    let bytes = std::fs::read(at("mesh.glb")).unwrap();
    let again = trisplat::read_bytes(&bytes, Format::Glb).unwrap();
    assert!(again.splats().is_none() && again.triangle_count() > 0);
}
