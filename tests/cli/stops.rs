//! A training that is stopped: before its own first step it begins again, after it goes on.

use super::stderr;
use super::train::succeed;
use super::train_teacher::{SHORT, few_photos, read, train_few};
use std::ops::ControlFlow::{self, Continue};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use trisplat::{Dataset, DatasetOptions, Error, TrainJob, TrainOptions};
use trisplat_job::{Event, TeacherSource, TrainPart};
use trisplat_scene::image::RgbImage;
use trisplat_synthetic::SyntheticOptions;
use trisplat_train::{Trained, checkpoint};

/// Photos in `folder/photos`: `views` of them, one in eight held out, that track `points`.
fn photos(folder: &Path, views: u32, points: u32) -> PathBuf {
    let folder = folder.join("photos");
    std::fs::create_dir(&folder).unwrap();
    let options = SyntheticOptions { views, width: 24, points, ..SyntheticOptions::default() };
    trisplat_synthetic::write(&folder, &options).unwrap();
    folder
}

/// Stops at a step of one of the trainings, counted from 0: the teacher's, the run.
#[derive(Default)]
struct Stopper {
    training: usize,
    at: Option<(usize, u64)>,
    teacher: Option<Trained>,
}

impl Stopper {
    fn tell(&mut self, event: &Event<'_>) -> ControlFlow<()> {
        match event {
            Event::TrainingStarted(begins) if begins.part != TrainPart::Scene => self.training += 1,
            Event::Teacher(teacher) => self.teacher = Some(Trained::clone(teacher)),
            Event::Step { sample, .. }
                if self.at.is_some_and(|(which, step)| {
                    self.training == which + 1 && sample.step >= step
                }) =>
            {
                return ControlFlow::Break(());
            }
            _ => {}
        }
        Continue(())
    }
}

fn job(photos: &Path, options: TrainOptions, point: &Path) -> TrainJob {
    let mut job =
        TrainJob::new(Dataset::load(photos, &DatasetOptions::default()).unwrap(), options);
    job.teacher = Some(TeacherSource::Auto);
    job.outputs.checkpoint = Some(point.to_owned());
    job.resume = point.is_file().then(|| checkpoint::read(point).unwrap());
    job
}

/// The shell alone would be a poor witness.
fn without_shell() -> TrainOptions {
    let mut options = TrainOptions::default();
    options.init.shell_subdivisions = 0;
    options
}

#[test]
fn resume_of_a_run_without_steps_gives_the_same_bits() {
    let folder = tempfile::tempdir().unwrap();
    let photos = photos(folder.path(), 20, 50);
    let point = folder.path().join("a.checkpoint");
    let mut observer = Stopper { at: Some((0, 9)), ..Stopper::default() };
    let error =
        job(&photos, without_shell(), &point).run(&mut |event| observer.tell(&event)).unwrap_err();
    let said = error.to_string();
    let what = "the training of a soft teacher scene, after 9 of ";
    assert!(matches!(error, Error::Stopped { .. }) && said.contains(what), "{said}");
    assert!(said.contains("nothing was written") && !point.exists(), "{said}");
    let mut observer = Stopper::default();
    let straight = job(&photos, without_shell(), &point)
        .run(&mut |event| observer.tell(&event))
        .unwrap()
        .trained;
    assert!(observer.training == 1 && observer.teacher.is_some());
    let again = job(&photos, without_shell(), &point).run(&mut |_| Continue(())).unwrap().trained;
    assert!(again.soup == straight.soup && again.steps == straight.steps);
}

/// The rest of a command that was printed after "to continue: ".
fn continuing(printed: &str) -> &str {
    let command = printed.lines().find_map(|line| line.split_once("to continue: trisplat "));
    command.unwrap_or_else(|| panic!("{printed}")).1
}

#[cfg(unix)]
fn typed(folder: &Path, words: &str) -> Command {
    let mut command = Command::new("sh");
    let program = env!("CARGO_BIN_EXE_trisplat");
    command
        .arg("-c")
        .arg(format!("exec '{program}' {words}"))
        .current_dir(folder)
        .stdin(Stdio::null());
    command
}

/// Runs `command` and sends `signal` as soon as a line of what it says holds `line`, and `file`
/// exists, if one is given.
#[cfg(unix)]
fn stop(command: &mut Command, line: &str, file: Option<&Path>, signal: &str) -> Output {
    use std::io::{BufRead, BufReader, Read};
    let mut child = command.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let mut said = BufReader::new(child.stderr.take().unwrap());
    let mut all = String::new();
    while !all.contains(line) {
        assert!(said.read_line(&mut all).unwrap() > 0, "it ended: {all}");
    }
    while file.is_some_and(|file| !file.exists()) {
        assert!(child.try_wait().unwrap().is_none(), "it ended: {all}");
        std::thread::sleep(std::time::Duration::from_millis(2));
    }
    succeed(Command::new("kill").args([signal, &child.id().to_string()]));
    said.read_to_string(&mut all).unwrap();
    Output { status: child.wait().unwrap(), stdout: Vec::new(), stderr: all.into_bytes() }
}

const TEACHER: &str = "a soft teacher scene is trained first";
const TRIAL: &str = "trial run on a validation split";
const JUDGED: &str = "of their estimated exposure";

#[cfg(unix)]
#[test]
fn signal_in_a_training_saves_it_and_prints_the_next_command() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    photos(folder, 20, 50);
    // The shell alone would be a poor witness.
    let options = "--set init.shell_subdivisions=0 --teacher auto";
    succeed(&mut typed(folder, &format!("train photos -o straight.ply {options}")));
    let log = folder.join("a.log");
    let words = format!("train photos -o a.ply --log a.log --log-every 1 {options}");
    std::fs::write(folder.join("a.teacher.ply"), b"precious").unwrap();
    let refused = typed(folder, &words).output().unwrap();
    let said = stderr(&refused);
    assert!(refused.status.code() == Some(1) && said.contains("a.teacher.ply"), "{said}");
    assert!(read(folder, "a.teacher.ply") == b"precious" && !folder.join("a.ply").exists());
    std::fs::remove_file(folder.join("a.teacher.ply")).unwrap();
    for (signal, code) in [("-HUP", 129), ("-INT", 130), ("-TERM", 143)] {
        let what = "stopped in the training of a soft teacher scene, after ";
        let output = stop(&mut typed(folder, &words), TEACHER, None, signal);
        let said = stderr(&output);
        assert_eq!(output.status.code(), Some(code), "{said}");
        assert!(said.contains(what) && said.contains("the same command begins again"), "{said}");
        assert!(!said.contains("error: ") && !folder.join("a.ply").exists(), "{said}");
    }
    let output = stop(&mut typed(folder, &words), TEACHER, Some(&log), "-QUIT");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(131), "{said}");
    let words = continuing(&said);
    assert_eq!(
        words,
        "train photos --output a.ply --teacher auto --log a.log --log-every 1 --force --resume a.checkpoint"
    );
    succeed(&mut typed(folder, words));
    assert!(read(folder, "a.teacher.ply") == read(folder, "straight.teacher.ply"));
    assert!(read(folder, "a.ply") == read(folder, "straight.ply"));
}

/// The limit is that of the run's own steps: its teacher is trained to the end.
#[cfg(unix)]
#[test]
fn a_run_with_a_requested_teacher_that_is_stopped_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    few_photos(folder);
    let flags = |more: &[&'static str]| [&SHORT as &[&str], &["--teacher", "auto"], more].concat();
    succeed(&mut train_few(folder, "straight.ply", &flags(&[])));
    let stopped = succeed(&mut train_few(folder, "a.ply", &flags(&["--max-cpu-secs", "1e-9"])));
    let said = stderr(&stopped);
    assert!(
        folder.join("a.checkpoint").is_file() && folder.join("a.teacher.ply").is_file(),
        "{said}"
    );
    succeed(&mut typed(folder, continuing(&said)));
    assert!(read(folder, "a.ply") == read(folder, "straight.ply"));
}

/// Darkens every other photo.
#[cfg(unix)]
fn differ_in_light(photos: &Path) {
    let entries =
        std::fs::read_dir(photos.join("images")).unwrap().map(|entry| entry.unwrap().path());
    let mut paths: Vec<PathBuf> = entries.collect();
    paths.sort();
    for path in paths.iter().step_by(2) {
        let mut photo = RgbImage::load(path).unwrap();
        photo.rgb.iter_mut().for_each(|rgb| *rgb = rgb.map(|code| code / 4 * 3));
        photo.save_png(path).unwrap();
    }
}

#[cfg(unix)]
fn make(folder: &Path, more: &str) -> Command {
    typed(folder, &format!("make photos -o scene.glb {more}"))
}

#[cfg(unix)]
#[test]
fn make_killed_at_any_part_ends_with_the_same_bytes() {
    let straight = tempfile::tempdir().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let straight = straight.path();
    let folder = folder.path();
    // Phones that differ by nothing would have no short training.
    for folder in [straight, folder] {
        differ_in_light(&photos(folder, 12, 600));
    }
    let steps = "--steps 1100 --max-triangles 40000";
    succeed(&mut make(straight, steps));
    let at = |name: &str| folder.join("scene.make").join(name);

    stop(&mut make(folder, steps), TRIAL, None, "-KILL");
    // Asked in the short trainings, and then in the run.
    let output = stop(&mut make(folder, steps), TRIAL, None, "-TERM");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(143), "{said}");
    assert!(said.contains("stopped; the same command goes on from scene.make"), "{said}");
    assert!(!at("scene.checkpoint").exists());
    let output = stop(&mut make(folder, steps), JUDGED, None, "-HUP");
    assert_eq!(output.status.code(), Some(129), "{}", stderr(&output));
    assert!(at("scene.checkpoint").exists());
    // Killed in the bake.
    stop(&mut make(folder, steps), "the training goes on", Some(&at("scene.ply")), "-KILL");
    assert!(!folder.join("scene.glb").exists());
    succeed(&mut make(folder, steps));
    assert!(!at("scene.checkpoint").exists(), "a finished training needs no checkpoint");
    for name in ["scene.make/scene.ply", "scene.glb", "scene.html"] {
        assert!(read(folder, name) == read(straight, name), "{name}");
    }
}
