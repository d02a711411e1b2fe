//! The steps of a capture, from photos and videos to a data set with poses. Finished steps are not repeated.
//!
//! ```text
//! inputs ──► photos ──► features ──► matches ──► model ──► verdict
//!            ours       └────── another program ──────┘    ours
//! ```

use super::collect::{self, PhotosDetails};
use super::logged::Log;
use super::observer::{CaptureObserver, Halt, Step};
use super::options::CaptureOptions;
use super::poses::{FoundModel, ModelDetails, Poses};
use super::program::{Places, Program};
use super::sheet;
use super::source::Sources;
use super::stored::{self, StoredPhotos, StoredStep, StoredSteps, WORK, place};
use super::verdict::{VerdictDetails, judge};
use std::path::{Path, PathBuf};
use std::time::Instant;
use trisplat_dataset::DatasetOptions;
use trisplat_dataset::tracks::tracks;
use trisplat_scene::atomic::{self, AtomicFolder, FolderLock};
use trisplat_scene::error::{Error, Result};
use trisplat_scene::input;
use trisplat_scene::report::{Counts, Report, StageDetails, StageReport, to_json};

/// Why a finished step is skipped.
const DONE: &str = "done before";
/// Files of a model.
const MODEL_FILES: [&str; 5] = ["cameras", "images", "points3D", "rigs", "frames"];

/// A capture job.
#[derive(Debug, Clone)]
pub struct Capture {
    /// Photos, videos and folders of them.
    pub inputs: Vec<PathBuf>,
    /// Output folder: `images`, `sparse/0`, and `capture` with the state of unfinished runs.
    pub folder: PathBuf,
    /// Options.
    pub options: CaptureOptions,
    /// Replace a capture of other inputs in the folder.
    pub force: bool,
}

impl Capture {
    /// A capture of `inputs` into `folder` with default options.
    pub fn new(inputs: impl IntoIterator<Item = PathBuf>, folder: PathBuf) -> Self {
        let (options, force) = (CaptureOptions::default(), false);
        Self { inputs: inputs.into_iter().collect(), folder, options, force }
    }

    /// Makes the data set and adds its steps to `report`. Returns the verdict, or `None` if `observer` stopped it: the next run
    /// of the same inputs continues from there.
    ///
    /// Errors: unreadable inputs; no pose program, or one that fails; photos that do not fit together; a folder that holds
    /// something else.
    pub fn run(
        &self,
        report: &mut Report,
        observer: &mut dyn CaptureObserver,
    ) -> Result<Option<VerdictDetails>> {
        let mut run = Run { job: self, report, observer };
        match run.all() {
            Ok(verdict) => Ok(Some(verdict)),
            Err(Halt::Stopped) => Ok(None),
            Err(Halt::Failed(error)) => Err(error),
        }
    }

    /// The inputs as text, for reports.
    fn names(&self) -> impl Iterator<Item = String> {
        self.inputs.iter().map(|path| path.display().to_string())
    }
}

struct Run<'a> {
    job: &'a Capture,
    report: &'a mut Report,
    observer: &'a mut dyn CaptureObserver,
}

impl Run<'_> {
    fn all(&mut self) -> Step<VerdictDetails> {
        let job = self.job;
        self.report.inputs.extend(job.names());
        check_apart(job)?;
        let sources = Sources::find(&job.inputs)?;
        self.report.warnings.extend(sources.warnings.iter().cloned());
        let program = Program::find(&job.options, &job.inputs[0])?;
        let photos = self.photos(&sources)?;
        let (model, key) = self.poses(program, &photos)?;
        self.publish(&model, key)?;
        self.verdict(&photos, &model.details)
    }

    /// Times and records a step. `run` returns the reason if there was nothing to do.
    fn stage<D: StageDetails, T>(
        &mut self,
        run: impl FnOnce(&mut Self, &mut D) -> Step<(T, Option<&'static str>)>,
    ) -> Step<T> {
        self.observer.started(D::STAGE);
        let (clock, mut details) = (Instant::now(), D::default());
        let (value, unneeded) = run(self, &mut details)?;
        let (before, after) = (Counts::default(), Counts::default());
        let (name, unneeded) = (D::STAGE.to_owned(), unneeded.map(str::to_owned));
        let (seconds, details) = (clock.elapsed().as_secs_f64(), to_json(&details));
        let stage = StageReport { name, seconds, before, after, unneeded, details };
        self.observer.finished(&stage);
        self.report.stages.push(stage);
        Ok(value)
    }

    fn photos(&mut self, sources: &Sources) -> Step<StoredPhotos> {
        self.stage(|run, details: &mut PhotosDetails| {
            let folder = &run.job.folder;
            let key = collect::key(sources, &run.job.options)?;
            if let Some(before) = earlier(folder, &key, run.job.force)? {
                details.photos = before.photos.len() as u64;
                details.frames = before.photos.iter().filter(|photo| photo.frame).count() as u64;
                return Ok((before, Some(DONE)));
            }
            let made = collect::collect(sources, folder, &run.job.options, &key, details, run.observer)?;
            Ok((made, None))
        })
    }

    /// The pose program's steps. Returns the model, and the key of its step if the model is new.
    fn poses(&mut self, program: Program, photos: &StoredPhotos) -> Step<(FoundModel, Option<String>)> {
        let folder = self.job.folder.clone();
        let _lock = FolderLock::take(&folder)?;
        let places = Places {
            images: folder.join("images"),
            database: place(&folder, "database.db"),
            pairs: place(&folder, "pairs.txt"),
            models: place(&folder, "models"),
        };
        let log = Log::open(&place(&folder, "poses.log"))?;
        let file = place(&folder, "steps.json");
        let mut steps: StoredSteps = stored::read(&file).unwrap_or_default();

        let features_key = format!("{} {}", photos.key, program.version);
        if steps.features.key != features_key {
            remove(&places.database)?;
            steps = StoredSteps::default();
        }
        let mut poses = Poses { program, places, photos, options: &self.job.options, log };
        let matches_key = format!("{features_key} {}", poses.pairing_key());
        let model_key = format!("{matches_key} {}", self.job.options.mapper.name());
        let poses = &mut poses;
        self.step(
            &file,
            &mut steps,
            |steps| &mut steps.features,
            &features_key,
            |run, details| poses.features(details, run.observer),
        )?;
        self.step(
            &file,
            &mut steps,
            |steps| &mut steps.matches,
            &matches_key,
            |run, details| poses.matches(details, run.observer),
        )?;
        let mut found = None;
        let sparse = folder.join("sparse").join("0");
        if !["images.bin", "images.txt"].iter().any(|name| sparse.join(name).is_file()) {
            steps.model.done = false;
        }
        self.step(
            &file,
            &mut steps,
            |steps| &mut steps.model,
            &model_key,
            |run, details| {
                let model = poses.model(run.observer)?;
                *details = model.details.clone();
                found = Some(model);
                Ok(())
            },
        )?;
        match found {
            Some(model) => Ok((model, Some(model_key))),
            None => {
                let details = serde_json::from_value(steps.model.details).unwrap_or_default();
                Ok((FoundModel { folder: folder.join("sparse").join("0"), details }, None))
            }
        }
    }

    /// One step of the program, unless finished. The model step is marked as finished later, when it is published.
    fn step<D: StageDetails>(
        &mut self,
        file: &Path,
        steps: &mut StoredSteps,
        which: fn(&mut StoredSteps) -> &mut StoredStep,
        key: &str,
        work: impl FnOnce(&mut Self, &mut D) -> Step<()>,
    ) -> Step<()> {
        self.stage(|run, details: &mut D| {
            if which(steps).is_done(key) {
                *details = serde_json::from_value(which(steps).details.clone()).unwrap_or_default();
                return Ok(((), Some(DONE)));
            }
            *which(steps) = StoredStep { key: key.to_owned(), ..StoredStep::default() };
            stored::write(file, steps)?;
            work(run, details)?;
            let details = serde_json::to_value(&*details).unwrap_or_default();
            let done = D::STAGE != ModelDetails::STAGE;
            *which(steps) = StoredStep { key: key.to_owned(), done, details };
            stored::write(file, steps)?;
            Ok(((), None))
        })
    }

    /// Moves a new model into the data set, then marks its step as finished.
    fn publish(&mut self, model: &FoundModel, key: Option<String>) -> Step<()> {
        let Some(key) = key else { return Ok(()) };
        let folder = &self.job.folder;
        let made = AtomicFolder::create(folder)?;
        let sparse = made.path().join("sparse").join("0");
        std::fs::create_dir_all(&sparse).map_err(|e| Error::io(&sparse, e))?;
        let named = |name: &str| ["bin", "txt"].map(|ending| format!("{name}.{ending}"));
        for name in MODEL_FILES.iter().flat_map(|name| named(name)) {
            let from = model.folder.join(&name);
            if from.is_file() {
                input::copy(&from, &sparse.join(name))?;
            }
        }
        made.publish("sparse/0/images")?;
        let file = place(folder, "steps.json");
        let mut steps: StoredSteps = stored::read(&file).unwrap_or_default();
        let details = serde_json::to_value(&model.details).unwrap_or_default();
        steps.model = StoredStep { key, done: true, details };
        Ok(stored::write(&file, &steps)?)
    }

    fn verdict(&mut self, photos: &StoredPhotos, model: &ModelDetails) -> Step<VerdictDetails> {
        self.stage(|run, details: &mut VerdictDetails| {
            let folder = &run.job.folder;
            let images = folder.join("images");
            let tracks = tracks(folder, &DatasetOptions::default())?;
            *details = judge(&images, photos, &tracks, model, run.observer)?;
            let picture = place(folder, "gaps.png");
            remove(&picture)?;
            if !details.gaps.is_empty() {
                sheet::draw(&images, &details.gaps)?.save_png(&picture)?;
                details.picture = Some(picture.display().to_string());
            }
            Ok((details.clone(), None))
        })
    }
}

fn remove(path: &Path) -> Result<()> {
    match std::fs::remove_file(path) {
        Err(e) if e.kind() != std::io::ErrorKind::NotFound => Err(Error::io(path, e)),
        _ => Ok(()),
    }
}

/// Refuses an output folder inside the input folder: the next run would take its photos as inputs.
fn check_apart(job: &Capture) -> Result<()> {
    let full = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let (mut folder, target) = (job.folder.as_path(), job.folder.display());
    // The part of the path that exists.
    while !folder.exists() {
        let Some(parent) = folder.parent().filter(|parent| !parent.as_os_str().is_empty()) else {
            folder = Path::new(".");
            break;
        };
        folder = parent;
    }
    let inside = |input: &&PathBuf| input.is_dir() && full(folder).starts_with(full(input));
    match job.inputs.iter().find(inside) {
        // With the current folder as input, any new folder in it is inside too.
        Some(input) => {
            Err(Error::invalid("output", target, format!("a folder outside of {}", input.display())))
        }
        None => Ok(()),
    }
}

/// The photos of an earlier run of the same inputs. Clears the folder for other inputs if asked.
///
/// Errors: a folder that holds another capture, or something else.
fn earlier(folder: &Path, key: &str, force: bool) -> Result<Option<StoredPhotos>> {
    let before: Option<StoredPhotos> = stored::read(&place(folder, "photos.json"));
    let is_whole = |photos: &StoredPhotos| {
        photos.photos.iter().all(|photo| folder.join("images").join(&photo.name).is_file())
    };
    match before {
        Some(before) if before.key == key && is_whole(&before) => Ok(Some(before)),
        Some(before) if before.key == key || force => {
            for name in ["images", "sparse", WORK] {
                let old = folder.join(name);
                if old.exists() {
                    std::fs::remove_dir_all(&old).map_err(|e| Error::io(&old, e))?;
                }
            }
            Ok(None)
        }
        Some(_) => {
            let wants =
                "a new folder, as this one holds the capture of other inputs; or `force`, to replace that";
            Err(Error::invalid("output", folder.display(), wants))
        }
        None => {
            let counts = |entry: std::io::Result<std::fs::DirEntry>| {
                entry.is_ok_and(|entry| !atomic::is_leftover(&entry.file_name().to_string_lossy()))
            };
            let holds_something = std::fs::read_dir(folder).is_ok_and(|mut entries| entries.any(counts));
            match holds_something {
                true => Err(Error::invalid("output", folder.display(), "a new or empty folder")),
                false => Ok(None),
            }
        }
    }
}
