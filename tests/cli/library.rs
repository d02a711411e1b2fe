//! The library makes the bytes of the program: whatever is decided between options and files is decided in the library.

use super::train::{dataset, succeed, train};
use super::train_teacher::{SHORT, few_photos, read, train_few};
use super::{sample, trisplat};
use serde_json::json;
use std::ops::ControlFlow::{self, Continue};
use std::path::Path;
use std::process::Command;
use trisplat::{BakeJob, BakeOptions, BakePreset, Dataset, DatasetOptions, TrainJob, TrainOptions};
use trisplat_job::{BakeDone, BakeInput, Event, TeacherSource, TrainDone};
use trisplat_scene::{Budget, Seconds, layered::Layers};
use trisplat_synthetic::SyntheticOptions;
use trisplat_train::Trained;

/// What the flags of [`train`] ask for; `given` are flags of the training.
fn job(given: serde_json::Value) -> TrainJob {
    let dataset_options = DatasetOptions {
        max_size: Some(80),
        background: "#203040".parse().unwrap(),
        ..DatasetOptions::default()
    };
    let layers = Layers::default().settings(&["densify.every=10".to_owned()]).given(given);
    let mut job = TrainJob::new(Dataset::load(dataset(), &dataset_options).unwrap(), TrainOptions::default());
    job.teacher = Some(TeacherSource::Off);
    (job.dataset_options, job.options) = (dataset_options, layers.resolve(TrainOptions::preset).unwrap());
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
    let TrainDone { trained, report, .. } = job.run(&mut observer).unwrap();
    assert!(bytes(folder, &trained) == scene);
    assert!(bytes(folder, &teacher.unwrap()) == read(folder, "a.teacher.ply"));
    assert_eq!(report.stages.iter().map(|stage| &stage.name).collect::<Vec<_>>(), ["teacher", "train"]);
}

/// Counts the short trainings, and stops one of them.
#[derive(Default)]
struct Watching {
    trainings: usize,
    said: String,
    stop: bool,
}

impl Watching {
    fn tell(&mut self, event: &Event<'_>) -> ControlFlow<()> {
        match event {
            Event::Begins(_) => self.trainings += 1,
            Event::Watched(watched) => self.said = watched.summary(),
            Event::Train(..) if self.stop => return ControlFlow::Break(()),
            _ => {}
        }
        Continue(())
    }
}

/// A training with a budget on `views` photos of the synthetic scene, one in eight of them held out.
fn with_budget(folder: &Path, views: u32, seconds: f64) -> TrainJob {
    let options = SyntheticOptions { views, width: 24, points: 50, ..SyntheticOptions::default() };
    trisplat_synthetic::write(folder, &options).unwrap();
    let photos = Dataset::load(folder, &DatasetOptions::default()).unwrap();
    let mut job = TrainJob::new(photos, TrainOptions::default());
    job.budget = Some(Budget::cpu(Seconds(seconds)));
    job
}

/// Short trainings leave some of the training photos out, and say whether a teacher helps.
#[test]
fn photos_are_watched_where_a_budget_has_time() {
    let folder = tempfile::tempdir().unwrap();
    let (asked, mut observer) = (with_budget(folder.path(), 20, 120.0), Watching::default());
    let mut job = asked.clone();
    job.watch(&mut |event| observer.tell(&event)).unwrap();
    job.watch(&mut |event| observer.tell(&event)).unwrap();
    let watched = job.watched.clone().unwrap();
    assert_eq!((observer.trainings, watched.solid.map(|training| training.steps)), (2, [425, 1275]));
    assert!(
        observer.said == watched.summary() && observer.said.contains("on 3 photos left out of training"),
        "{}",
        observer.said
    );
    let trained: Vec<&String> = job.dataset.train().map(|view| &view.name).collect();
    assert_eq!((trained.len(), watched.photos.len()), (17, 3));
    assert!(watched.photos.iter().all(|name| trained.contains(&name)), "{:?}", watched.photos);
    // Without the time, and without a teacher, nothing is watched.
    let (mut without, mut hurried) = (asked.clone(), asked);
    without.teacher = Some(TeacherSource::Off);
    hurried.budget = Some(Budget::cpu(Seconds(39.0)));
    for mut job in [without, hurried] {
        job.watch(&mut |_| Continue(())).unwrap();
        assert!(job.watched.is_none());
    }
}

/// Whether 21 photos need a teacher is asked first. Who stops it is told that nothing was written.
#[test]
fn watching_can_be_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = with_budget(folder.path(), 24, 120.0);
    let mut observer = Watching { stop: true, ..Watching::default() };
    let error = job.watch(&mut |event| observer.tell(&event)).unwrap_err().to_string();
    assert!(error.contains("of 525 steps") && error.contains("nothing was written"), "{error}");
    assert_eq!((observer.trainings, job.watched), (1, None));
}

/// A long run asks without a budget, too; a short one, and one that may be stopped early, do not.
#[test]
fn a_long_run_without_a_budget_watches_photos() {
    let folder = tempfile::tempdir().unwrap();
    let mut long = with_budget(folder.path(), 24, 120.0);
    long.budget = None;
    let mut short = long.clone();
    short.options.options.steps = 100;
    short.options.options.max_triangles = 1000;
    let mut limited = long.clone();
    limited.outputs.max_cpu_secs = 1e6;
    let trainings = |mut job: TrainJob| {
        let mut observer = Watching { stop: true, ..Watching::default() };
        let watched = job.watch(&mut |event| observer.tell(&event));
        (observer.trainings, watched.is_ok())
    };
    assert_eq!([long, short, limited].map(trainings), [(1, false), (0, true), (0, true)]);
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
    command.current_dir(folder).arg("bake").arg(input).args(["-o", "program.glb", "--force"]).args(flags);
    succeed(&mut command);
    read(folder, "program.glb")
}

fn library(folder: &Path, job: BakeJob) -> (Vec<u8>, BakeDone) {
    let done = job.save(&folder.join("library.glb"), &mut |_| Continue(())).unwrap();
    (read(folder, "library.glb"), done)
}

fn bake(input: &Path) -> BakeJob {
    BakeJob::new([BakeInput::File(input.to_owned())], BakeOptions::default())
}

#[test]
fn a_bake_by_default_and_with_photos() {
    let folder = tempfile::tempdir().unwrap();
    let (folder, trained) = (folder.path(), sample("trained.ply"));
    assert!(library(folder, bake(&trained)).0 == baked(folder, &trained, &[]));
    let mut with_photos = bake(&trained);
    with_photos.options = BakeOptions::preset(BakePreset::Fast);
    with_photos.photos = Some(Dataset::load(dataset(), &DatasetOptions::default()).unwrap());
    let photos = dataset().display().to_string();
    let program = baked(folder, &trained, &["--preset", "fast", "--dataset", &photos, "--max-bytes", "60kB"]);
    with_photos.max_bytes = Some(60_000);
    assert!(library(folder, with_photos).0 == program);
}

/// A soft scene of few triangles.
fn soft(folder: &Path) -> std::path::PathBuf {
    few_photos(folder);
    succeed(&mut train_few(folder, "soft.ply", &[&SHORT as &[&str], &["--preset", "outdoor"]].concat()));
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
    assert!(first.eq(["background", "train"]), "the background is found before the training draws pictures");
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
    let output = trisplat(&[&"bake", &sample("trained.ply"), &"-o", &program, &"--target", &"godot"]);
    assert!(output.status.success());
    assert!(std::fs::read(out).unwrap() == std::fs::read(program).unwrap());
}
