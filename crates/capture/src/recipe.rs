//! The steps of a capture, from photos and videos to a data set with poses. Finished steps are not repeated.
//!
//! ```text
//! inputs ──► photos ──► features ──► matches ──► model ──► verdict
//!            ours       └────── another program ──────┘    ours
//! ```

use super::collect::{self, PhotosDetails};
use super::folder::CaptureFolder;
use super::logged::Log;
use super::options::CaptureOptions;
use super::poses::{FeaturesDetails, FoundModel, MatchesDetails, ModelDetails, Poses, StepKeys};
use super::program::{Places, Program};
use super::sheet;
use super::source::Sources;
use super::step::{Halt, Step, tell};
use super::stored::{self, StoredPhotos, StoredStep, StoredSteps, place};
use super::verdict::{VerdictDetails, judge};
use serde::de::DeserializeOwned;
use std::path::{Path, PathBuf};
use std::time::Instant;
use trisplat_dataset::{DatasetOptions, tracks};
use trisplat_scene::{
    Error, Result,
    atomic::{FolderLock, lies_inside},
    report::{Counts, Report, StageDetails, StageEvent, StageObserver, StageReport, to_json},
};

/// Why a finished step is skipped.
const DONE: &str = "done before";

/// A capture job.
#[derive(Debug, Clone)]
pub struct Capture {
    /// Photos, videos and folders of them.
    pub inputs: Vec<PathBuf>,
    /// Output folder: `images`, `sparse/0`, and `capture` with the state of unfinished runs.
    pub folder: PathBuf,
    /// Options.
    pub options: CaptureOptions,
    /// Replace a capture of other inputs in the folder. It stays until the new one is whole.
    pub force: bool,
    /// Fewer photos are refused before anything runs, unless there is a video.
    pub least_photos: usize,
}

impl Capture {
    /// A capture of `inputs` into `folder` with default options.
    pub fn new(inputs: impl IntoIterator<Item = PathBuf>, folder: PathBuf) -> Self {
        let (options, force) = (CaptureOptions::default(), false);
        Self { inputs: inputs.into_iter().collect(), folder, options, force, least_photos: 1 }
    }

    /// Makes the data set and adds its steps to `report`. Returns the verdict, or `None` if `observer` stopped it: the next run
    /// of the same inputs continues from there.
    ///
    /// Errors: unreadable inputs; no pose program, or one that fails; photos that do not fit together; a folder that holds
    /// something else.
    pub fn run(&self, report: &mut Report, observer: StageObserver<'_>) -> Result<Option<VerdictDetails>> {
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
    observer: StageObserver<'a>,
}

impl Run<'_> {
    fn all(&mut self) -> Step<VerdictDetails> {
        let job = self.job;
        self.report.inputs.extend(job.names());
        check_apart("output", &job.folder, &job.inputs)?;
        let sources = Sources::find(&job.inputs)?;
        check_apart("output", &job.folder, &sources.places(&job.inputs))?;
        sources.check_number(job.least_photos, &job.inputs[0])?;
        self.report.warnings.extend(sources.warnings.iter().cloned());
        let program = Program::find(&job.options, &job.inputs[0])?;
        let key = collect::key(&sources, &job.options)?;
        let mut folder = CaptureFolder::choose(&job.folder, &key, job.force)?;
        let made = self.make(&mut folder, &sources, program, &key);
        let finished = folder.manifest.finish();
        let verdict = made?;
        finished?;
        Ok(verdict)
    }

    /// All steps in `folder`.
    fn make(
        &mut self,
        folder: &mut CaptureFolder,
        sources: &Sources,
        program: Program,
        key: &str,
    ) -> Step<VerdictDetails> {
        let photos = self.photos(folder, sources, key)?;
        let (model, key) = self.poses(folder, program, &photos)?;
        publish(folder, &model, key)?;
        folder.take_place()?;
        self.verdict(folder, &photos, &model.details)
    }

    /// Times and records a step. `run` returns the reason if there was nothing to do.
    fn stage<D: StageDetails, T>(
        &mut self,
        run: impl FnOnce(&mut Self, &mut D) -> Step<(T, Option<&'static str>)>,
    ) -> Step<T> {
        tell(self.observer, StageEvent::Started(D::STAGE))?;
        let (clock, mut details) = (Instant::now(), D::default());
        let (value, skipped) = run(self, &mut details)?;
        let (before, after) = (Counts::default(), Counts::default());
        let (name, skipped) = (D::STAGE.to_owned(), skipped.map(str::to_owned));
        let (seconds, details) = (clock.elapsed().as_secs_f64(), to_json(&details));
        let stage = StageReport { name, seconds, before, after, skipped, details };
        let told = tell(self.observer, StageEvent::Finished(&stage));
        self.report.stages.push(stage);
        told.map(|()| value)
    }

    fn photos(&mut self, folder: &mut CaptureFolder, sources: &Sources, key: &str) -> Step<StoredPhotos> {
        self.stage(|run, details: &mut PhotosDetails| {
            if let Some(before) = folder.photos()? {
                details.photos = before.photos.len() as u64;
                details.frames = before.photos.iter().filter(|photo| photo.frame).count() as u64;
                return Ok((before, Some(DONE)));
            }
            let made = collect::collect(sources, folder, &run.job.options, key, details, run.observer)?;
            Ok((made, None))
        })
    }

    /// The pose program's steps. Returns the model, and the key of its step if the model is new.
    fn poses(
        &mut self,
        folder: &mut CaptureFolder,
        program: Program,
        photos: &StoredPhotos,
    ) -> Step<(FoundModel, Option<String>)> {
        let path = &folder.path.clone();
        let _lock = FolderLock::take(path)?;
        let file = place(path, "steps.json");
        let mut steps: StoredSteps = stored::read(&file)?.unwrap_or_default();
        let keys = StepKeys::of(&program, photos, &self.job.options);
        let sparse = path.join("sparse").join("0");
        if !["images.bin", "images.txt"].iter().any(|name| sparse.join(name).is_file()) {
            steps.model.done = false;
        }
        let done = [
            steps.features.is_done(&keys.features),
            steps.matches.is_done(&keys.matches),
            steps.model.is_done(&keys.model),
        ];
        if done == [true; 3] {
            self.done::<FeaturesDetails>(&steps.features)?;
            self.done::<MatchesDetails>(&steps.matches)?;
            let details = self.done::<ModelDetails>(&steps.model)?;
            return Ok((FoundModel { folder: sparse, details }, None));
        }
        folder.begin_poses()?;
        let places = Places {
            images: path.join("images"),
            database: place(path, "database.db"),
            pairs: place(path, "pairs.txt"),
            models: place(path, "models"),
        };
        let log = Log::open(&place(path, "poses.log"))?;
        // Photos that a second process adds to a database would get a camera of their own: its lens, found from a few photos, may be absurd.
        if !steps.features.is_done(&keys.features) || !places.database.is_file() {
            folder.remove_database()?;
            steps = StoredSteps::default();
        }
        let poses = &mut Poses { program, places, photos, options: &self.job.options, log };
        self.step(
            &file,
            &mut steps,
            |steps| &mut steps.features,
            &keys.features,
            |run, details| poses.features(details, run.observer),
        )?;
        self.step(
            &file,
            &mut steps,
            |steps| &mut steps.matches,
            &keys.matches,
            |run, details| poses.matches(details, run.observer),
        )?;
        let mut found = None;
        self.step(
            &file,
            &mut steps,
            |steps| &mut steps.model,
            &keys.model,
            |run, details: &mut ModelDetails| {
                let model = poses.model(run.observer)?;
                *details = model.details.clone();
                found = Some(model);
                Ok(())
            },
        )?;
        match found {
            Some(model) => Ok((model, Some(keys.model))),
            None => {
                let details = serde_json::from_value(steps.model.details).unwrap_or_default();
                Ok((FoundModel { folder: sparse, details }, None))
            }
        }
    }

    /// A row for a step that an earlier run finished.
    fn done<D: StageDetails + DeserializeOwned + Clone>(&mut self, step: &StoredStep) -> Step<D> {
        self.stage(|_, details: &mut D| {
            *details = serde_json::from_value(step.details.clone()).unwrap_or_default();
            Ok((details.clone(), Some(DONE)))
        })
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

    fn verdict(
        &mut self,
        folder: &mut CaptureFolder,
        photos: &StoredPhotos,
        model: &ModelDetails,
    ) -> Step<VerdictDetails> {
        const PICTURE: &str = "capture/gaps.png";
        self.stage(|run, details: &mut VerdictDetails| {
            let images = folder.path.join("images");
            let tracks = tracks(&folder.path, &DatasetOptions::default())?;
            *details = judge(&images, photos, &tracks, model, run.observer)?;
            if details.gaps.is_empty() {
                folder.manifest.remove(&[PICTURE])?;
            } else {
                let picture = folder.path.join(PICTURE);
                folder.manifest.begin(&[PICTURE])?;
                sheet::draw(&images, &details.gaps)?.save_png(&picture)?;
                details.picture = Some(picture.display().to_string());
            }
            Ok((details.clone(), None))
        })
    }
}

/// Moves a new model into the data set, then marks its step as finished.
fn publish(folder: &mut CaptureFolder, model: &FoundModel, key: Option<String>) -> Result<()> {
    let Some(key) = key else { return Ok(()) };
    folder.publish_model(&model.folder)?;
    let file = place(&folder.path, "steps.json");
    let mut steps: StoredSteps = stored::read(&file)?.unwrap_or_default();
    let details = serde_json::to_value(&model.details).unwrap_or_default();
    steps.model = StoredStep { key, done: true, details };
    stored::write(&file, &steps)
}

/// Refuses photos in the output folder, and an output folder among the photos: the next run would take its photos as inputs.
/// `option` names the folder.
pub fn check_apart(option: &str, folder: &Path, photos: &[PathBuf]) -> Result<()> {
    for photo in photos {
        if photo.is_dir() && lies_inside(folder, photo) {
            let wants = format!("a folder outside of {}", photo.display());
            return Err(Error::invalid(option, folder.display(), wants));
        }
        if lies_inside(photo, folder) {
            let reason = format!(
                "lies in the output folder {}; move the photos elsewhere, or give another folder",
                folder.display()
            );
            return Err(Error::unsupported(photo, reason));
        }
    }
    Ok(())
}
