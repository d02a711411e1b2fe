//! From photos, a video or a data set to files for an engine: capture, training, bake. Finished
//! parts are not repeated.

use super::baking::{BakeInput, BakeJob};
use super::evaluate::EvalJob;
use super::event::{Event, MakePart, Observer, add, stages};
use super::photo_check::check_photos;
use super::scores::{RepresentationScore, SharedPixels};
use super::training::{TrainJob, TrainResult, reading};
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;
use trisplat_bake::{BackdropWhen, BakeOptions, BakePreset};
use trisplat_dataset::capture::{Capture, CaptureOptions, VerdictDetails, check_apart};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::output::{self, OutputFormat};
use trisplat_scene::atomic::{AtomicFile, FileManifest, MadeFolders};
use trisplat_scene::layered::Layered;
use trisplat_scene::report::{Report, StageReport};
use trisplat_scene::{Asset, Error, Limits, Provenance, Region, Result, Seconds, input};
use trisplat_train::{BackendOptions, Checkpoint, TrainOptions, TrainOutputs, checkpoint};

/// Share of the budget for training; the bake needs less than the rest.
const TRAINING: f64 = 0.85;
/// Steps between checkpoints: a killed run loses at most these.
const CHECKPOINT_EVERY: u64 = 500;
/// Maximum size of a subject, as a share of the cameras' distance: a larger one surrounds them, as
/// a room does.
const MAX_SUBJECT_SHARE: f64 = 0.6;
/// Minimum number of photos: fewer show no shape, or leave none to judge it by.
const MIN_PHOTOS: usize = 3;
/// Reason in the report for skipping a finished part.
const DONE: &str = "done before";
/// List of the training's files in the working folder.
const FILES: &str = "files.json";
const SCENE: &str = "scene.ply";
const CHECKPOINT: &str = "scene.checkpoint";
const NOTES: &str = "training.json";
const TEACHER: &str = "scene.teacher.ply";

/// A job that does everything: capture, training, bake. [`MakeJob::new`] fills in the defaults; set
/// any field before running it.
#[derive(Debug, Clone)]
pub struct MakeJob {
    /// Photos, videos or folders of them; or one data set with poses.
    pub inputs: Vec<PathBuf>,
    /// The file to write.
    pub output: PathBuf,
    /// The page to write beside it.
    pub page: Option<PathBuf>,
    /// The report to write as JSON, last.
    pub report: Option<PathBuf>,
    /// Working folder, from which an interrupted job continues: the captured data set, checkpoints,
    /// the trained scene. Files that this job did not write there are never replaced.
    pub work: PathBuf,
    /// Capture options: frames and poses.
    pub capture: CaptureOptions,
    /// Set photos of other inputs in the working folder aside, as `photos.old`.
    pub force: bool,
    /// Train although the photos can hardly make a scene: few points tie them, or they share too
    /// little.
    pub anyway: bool,
    /// Options for reading the data set.
    pub dataset_options: DatasetOptions,
    /// Training options.
    pub train: TrainOptions,
    /// Training backend.
    pub backend: BackendOptions,
    /// Bake options.
    pub bake: BakeOptions,
    /// CPU time for training and bake together; `None`: the steps of `train`, so equal jobs make
    /// equal bytes.
    pub budget: Option<Seconds>,
}

/// The result of a [`MakeJob`].
#[derive(Debug, Clone)]
pub struct MakeDone {
    /// All stages, files and warnings.
    pub report: Report,
    /// The data set that was trained on.
    pub dataset: PathBuf,
    /// Quality of the capture; `None` for a given data set.
    pub verdict: Option<VerdictDetails>,
    /// Score of the file on held-out photos; `None` if it is not the whole scene or is of a format
    /// without a reader.
    pub score: Option<RepresentationScore>,
    /// PSNR of these photos where at least two that training saw look, dB, by name; empty without a
    /// score.
    pub judged: Vec<(String, f64)>,
    /// PSNR of an earlier run for the same photos with less time or fewer steps, dB.
    pub earlier: Option<f64>,
    /// Photos that training saw.
    pub trained_on: usize,
    /// The file of the subject alone, if the capture has one.
    pub subject: Option<PathBuf>,
    /// Reason why there is none, where one was tried.
    pub no_subject: Option<&'static str>,
    /// True after a stop; the same job continues from there.
    pub stopped: bool,
}

/// A finished training.
#[derive(Debug, Default, Serialize, Deserialize)]
struct StoredTraining {
    /// Its inputs and options, as text.
    key: String,
    stages: Vec<StageReport>,
    warnings: Vec<String>,
    /// New files that a bake of it writes, until all are there.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    outputs: Vec<PathBuf>,
    /// The part of the key that names the photos.
    #[serde(default)]
    photos: String,
    /// Budget in seconds, or steps.
    #[serde(default)]
    effort: f64,
    /// PSNR of its file, dB.
    psnr: Option<f64>,
    /// PSNR of an earlier run with less effort, dB.
    earlier: Option<f64>,
}

impl StoredTraining {
    /// The score of a run before `self` with less effort, if `last` was one, or knows it.
    fn after(mut self, last: Option<&Self>) -> Self {
        let last = last.filter(|last| last.photos == self.photos);
        self.earlier = last.and_then(|last| {
            if last.key == self.key {
                last.earlier
            } else {
                last.psnr.filter(|_| last.effort < self.effort)
            }
        });
        self
    }

    /// Adds the figures of a finished training to `report`.
    fn add_to(&self, report: &mut Report, observer: Observer<'_>) {
        for stage in &self.stages {
            let stage = StageReport { skipped: Some(DONE.into()), seconds: 0.0, ..stage.clone() };
            add(stage, report, observer);
        }
        report.warnings.extend(self.warnings.iter().cloned());
    }
}

impl MakeJob {
    /// A job that makes `output` from `inputs` within ten minutes of CPU time.
    pub fn new(inputs: impl IntoIterator<Item = PathBuf>, output: PathBuf) -> Self {
        Self {
            inputs: inputs.into_iter().collect(),
            page: None,
            report: None,
            work: output.with_extension("make"),
            output,
            capture: CaptureOptions::default(),
            force: false,
            anyway: false,
            dataset_options: DatasetOptions::default(),
            train: TrainOptions::default(),
            backend: BackendOptions::default(),
            bake: BakeOptions::preset_for_photos(BakePreset::Default),
            budget: Some(Seconds(600.0)),
        }
    }

    /// Runs every unfinished part, to the end or until `observer` stops it. Existing files are
    /// replaced.
    ///
    /// # Errors
    ///
    /// Errors of [`Capture::run`], [`TrainJob::run`] and [`BakeJob::save`].
    pub fn run(mut self, observer: Observer<'_>) -> Result<MakeDone> {
        let clock = Instant::now();
        // Removed if it stays empty.
        let _made = MadeFolders::make(&self.work)?;
        let mut done = self.find_poses(observer)?;
        if !done.stopped {
            done.stopped = !self.train_once(&done.dataset, &mut done.report, observer)?;
        }
        done.stopped = done.stopped || observer(Event::Part(MakePart::Bake)).is_break();
        if !done.stopped {
            self.bake_and_score(&mut done, observer)?;
        }
        done.report.seconds = clock.elapsed().as_secs_f64();
        if !done.stopped {
            if let Some(path) = &self.report {
                save(path, &done.report)?;
            }
            // Until here, the next run would replace the outputs. All are whole, so a note that
            // cannot be written costs nothing.
            let _ = self.note(Vec::new());
        }
        Ok(done)
    }

    /// Start the result with a data set: the input, or a capture of it.
    fn find_poses(&self, observer: Observer<'_>) -> Result<MakeDone> {
        let mut done = MakeDone {
            report: Report::new("make"),
            dataset: self.work.join("photos"),
            verdict: None,
            score: None,
            judged: Vec::new(),
            earlier: None,
            trained_on: 0,
            subject: None,
            no_subject: None,
            stopped: false,
        };
        if let [posed] = &self.inputs[..]
            && Dataset::is_posed(posed)
        {
            done.report.inputs.push(posed.display().to_string());
            let skipped = StageReport::skipped("capture", "the photos have poses".into());
            add(skipped, &mut done.report, observer);
            posed.clone_into(&mut done.dataset);
            return Ok(done);
        }
        check_apart("work", &self.work, &self.inputs)?;
        let _ = observer(Event::Part(MakePart::Capture));
        let mut job = Capture::new(self.inputs.iter().cloned(), done.dataset.clone());
        job.options = self.capture.clone();
        job.force = self.force;
        job.skip_broken = self.dataset_options.skip_broken;
        job.least_photos = MIN_PHOTOS;
        done.verdict = job.run(&mut done.report, &mut stages(observer))?;
        done.stopped = done.verdict.is_none();
        let hopeless = done.verdict.as_ref().and_then(VerdictDetails::hopeless);
        if let Some(why) = hopeless.filter(|_| !self.anyway) {
            let reason = format!(
                "is a poor capture: {why}; take photos that overlap by half or more, or train with `anyway`"
            );
            return Err(Error::unsupported(&done.dataset, reason));
        }
        Ok(done)
    }

    /// Bake the trained scene and score its file.
    fn bake_and_score(&mut self, done: &mut MakeDone, observer: Observer<'_>) -> Result<()> {
        let photos = Dataset::load(&done.dataset, &self.dataset_options)?;
        let subject = self.bake(&photos, &mut done.report, observer);
        (done.subject, done.no_subject) = subject.map_err(|error| match error {
            Error::ForeignPhotos { fault, .. } => {
                let reason = format!(
                    "has {fault}; train longer, or take photos that overlap by half or more"
                );
                Error::unsupported(&done.dataset, reason)
            }
            error => error,
        })?;
        done.trained_on = photos.train().count();
        done.score = self.score(&photos, &mut done.judged)?;
        done.earlier = self.remember(done.score.as_ref())?;
        Ok(())
    }

    /// Trains, and keeps the list of written files. Returns false when stopped.
    fn train_once(&self, path: &Path, report: &mut Report, observer: Observer<'_>) -> Result<bool> {
        let mut ours = FileManifest::read(&self.work, FILES)?;
        let trained = self.train(path, &mut ours, report, observer);
        let began = [SCENE, CHECKPOINT, TEACHER].iter().any(|name| self.work.join(name).exists());
        let finished = if trained.is_ok() || began { ours.finish() } else { ours.clear() };
        let trained = trained?;
        finished.map(|()| trained)
    }

    /// Trains unless a finished training exists. Returns false when stopped.
    fn train(
        &self,
        path: &Path,
        ours: &mut FileManifest,
        report: &mut Report,
        observer: Observer<'_>,
    ) -> Result<bool> {
        let [scene, point, notes] = [SCENE, CHECKPOINT, NOTES].map(|name| self.work.join(name));
        let (photos, key) = self.training_key(path)?;
        let effort = self.budget.map_or(self.train.steps as f64, |budget| budget.0);
        let last = stored(&notes);
        let current = StoredTraining { key, photos, effort, ..StoredTraining::default() }
            .after(last.as_ref());
        let before = last.filter(|before| before.key == current.key);
        if let Some(before) =
            before.as_ref().filter(|before| !before.stages.is_empty() && scene.is_file())
        {
            before.add_to(report, observer);
            return ours.remove(CHECKPOINT).map(|()| true);
        }
        // A checkpoint made from other photos or options is ignored, and so is a damaged one.
        let resume = before.and_then(|_| checkpoint::read(&point).ok());
        ours.begin(&[SCENE, CHECKPOINT, NOTES, TEACHER])?;
        if resume.is_none() && point.exists() {
            // From here on the notes name this training, and a checkpoint beside them would pass
            // for its own.
            std::fs::remove_file(&point).map_err(|e| Error::io(&point, e))?;
        }
        save(&notes, &current)?;
        let job = self.training_job(path, resume)?;
        if observer(Event::Part(MakePart::Train)).is_break() {
            return Ok(false);
        }
        let Some(done) = self.run_training(job, observer)? else { return Ok(false) };
        done.trained.save(&scene)?;
        let stages = done.report.stages;
        let warnings = done.report.warnings;
        let finished =
            StoredTraining { stages: stages.clone(), warnings: warnings.clone(), ..current };
        save(&notes, &finished)?;
        ours.remove(CHECKPOINT)?;
        for stage in stages {
            add(stage, report, observer);
        }
        report.warnings.extend(warnings);
        Ok(true)
    }

    /// The training on the photos of `path`, from the beginning or from a checkpoint.
    ///
    /// # Errors
    ///
    /// Photos that cannot be read; too few of them, or such that show no scene.
    fn training_job(&self, path: &Path, resume: Option<Checkpoint>) -> Result<TrainJob> {
        let reading = reading(&self.dataset_options, resume.as_ref());
        let photos = Dataset::load(path, &reading)?;
        if photos.views.len() < MIN_PHOTOS {
            let count = match photos.views.len() {
                1 => "1 photo is".to_owned(),
                count => format!("{count} photos are"),
            };
            let reason = format!("{count} not enough; give {MIN_PHOTOS} or more");
            return Err(Error::unsupported(path, reason));
        }
        if !self.anyway {
            check_photos(&photos, path)?;
        }
        let mut job = TrainJob::new(photos, self.train.clone());
        job.dataset_options = reading;
        job.backend = self.backend.clone();
        job.teacher_file = Some(self.work.join(TEACHER));
        job.began = Some(Instant::now());
        match &resume {
            Some(point) => {
                let options = &point.meta.options;
                job.options = Layered::over(options, options.clone());
            }
            None => job.limit(self.budget, TRAINING),
        }
        job.resume = resume;
        job.outputs = TrainOutputs {
            checkpoint: Some(self.work.join(CHECKPOINT)),
            checkpoint_every: CHECKPOINT_EVERY,
            ..TrainOutputs::default()
        };
        Ok(job)
    }

    /// Runs a training and writes its teacher; `None` when stopped.
    fn run_training(&self, job: TrainJob, observer: Observer<'_>) -> Result<Option<TrainResult>> {
        let mut teacher_error = None;
        let mut save_teacher = |event: Event<'_>| {
            if let Event::Teacher(trained) = &event {
                teacher_error = trained.save(self.work.join(TEACHER)).err();
            }
            let flow = observer(event);
            if teacher_error.is_some() { ControlFlow::Break(()) } else { flow }
        };
        let done = job.run(&mut save_teacher);
        if let Some(error) = teacher_error {
            return Err(error);
        }
        match done {
            Err(Error::Stopped { .. }) => Ok(None),
            done => Ok(Some(done?).filter(|done| !done.trained.stopped)),
        }
    }

    /// Score the file on the held-out photos as `trisplat eval` does. `judged` gets the PSNR of
    /// pixels that two training photos show.
    fn score(
        &self,
        photos: &Dataset,
        judged: &mut Vec<(String, f64)>,
    ) -> Result<Option<RepresentationScore>> {
        let is_read = matches!(
            OutputFormat::of(&self.output),
            Ok(OutputFormat::Glb | OutputFormat::Gltf | OutputFormat::Obj | OutputFormat::Ply)
        );
        let is_apart =
            matches!(self.bake.backdrop.backdrop, BackdropWhen::File | BackdropWhen::Sky);
        if !is_read || is_apart || !self.bake.crop.crop.is_empty() || photos.test().next().is_none()
        {
            return Ok(None);
        }
        let mut job = EvalJob::new(&self.output);
        job.dataset_options = self.dataset_options.clone();
        job.extrapolation = false;
        let ready = job.prepare(photos)?;
        let bytes = self.dataset_options.photo_bytes();
        let twice = |surface| SharedPixels::new(surface, photos, ready.views(), bytes);
        let mut twice = ready.surface().and_then(twice);
        let mut report = ready.run(|i, drawn| {
            if let (Some(twice), Some(drawn)) = (&mut twice, drawn.last()) {
                judged.extend(twice.psnr(i, &drawn.picture)?);
            }
            Ok(())
        })?;
        Ok(report.steps.pop())
    }

    /// Notes the score for the next run; returns that of an earlier one with less effort.
    fn remember(&self, score: Option<&RepresentationScore>) -> Result<Option<f64>> {
        let notes = self.work.join(NOTES);
        let Some(before) = stored(&notes) else { return Ok(None) };
        let earlier = before.earlier;
        let psnr = score.map(|score| score.mean.psnr);
        if psnr.is_some() && psnr != before.psnr {
            let mut ours = FileManifest::read(&self.work, FILES)?;
            ours.begin(&[NOTES])?;
            save(&notes, &StoredTraining { psnr, ..before })?;
            ours.finish()?;
        }
        Ok(earlier)
    }

    /// Everything that a training depends on: photos and poses, and these with the options.
    fn training_key(&self, path: &Path) -> Result<(String, String)> {
        let meta = |path: &Path| {
            let meta = std::fs::metadata(path).ok();
            format!("{:?}", meta.map(|meta| (meta.len(), meta.modified().ok())))
        };
        let files: Vec<String> = Dataset::pose_files(path).iter().map(|file| meta(file)).collect();
        let options = (&self.dataset_options, &self.train, self.budget);
        let mut options = serde_json::to_string(&options)
            .map_err(|e| Error::invalid("options", e, "finite numbers"))?;
        if self.backend != BackendOptions::default() {
            options += &format!(" {:?}", self.backend);
        }
        let full = std::fs::canonicalize(path).map_err(|e| Error::io(path, e))?;
        let list = if path.is_file() { meta(path) } else { files.join(" ") };
        let photos = format!("{} {list}", full.display());
        Ok((photos.clone(), format!("{photos} {options}")))
    }

    /// Outputs that an interrupted run of this job wrote: it may replace them.
    pub fn unfinished(&self) -> Vec<PathBuf> {
        stored(&self.work.join(NOTES)).map(|notes| notes.outputs).unwrap_or_default()
    }

    /// Enters the outputs that a bake is about to write.
    fn note(&self, outputs: Vec<PathBuf>) -> Result<()> {
        let notes = self.work.join(NOTES);
        let Some(before) = stored(&notes) else { return Ok(()) };
        let mut ours = FileManifest::read(&self.work, FILES)?;
        ours.begin(&[NOTES])?;
        save(&notes, &StoredTraining { outputs, ..before })?;
        ours.finish()
    }

    /// The file of the subject alone, beside that of everything: OUT.subject.glb. `None` where a
    /// region was asked for, and of formats without files beside them.
    pub fn subject_file(&self) -> Option<PathBuf> {
        use OutputFormat::{Glb, Gltf, Obj, Ply, Usdz};
        let has_one = matches!(OutputFormat::of(&self.output), Ok(Glb | Gltf | Obj | Ply | Usdz));
        let ending = self.output.extension()?.to_str()?;
        let file = || self.output.with_extension(format!("subject.{ending}"));
        (has_one && self.bake.crop.crop.is_empty()).then(file)
    }

    /// The options for the file of the subject.
    pub fn subject_bake(&self) -> BakeOptions {
        let mut options = self.bake.clone();
        options.crop.crop = vec![Region::Subject];
        options
    }

    /// Bakes, and writes the file, the page, and the file of the subject, whose path it returns, or
    /// else why there is none. The notes list them until all are written.
    fn bake(
        &mut self,
        photos: &Dataset,
        report: &mut Report,
        observer: Observer<'_>,
    ) -> Result<(Option<PathBuf>, Option<&'static str>)> {
        let planned = self.bake.plan_output(&self.output, None)?;
        let unfinished = self.unfinished();
        let mut new: Vec<PathBuf> = planned.paths().map(Path::to_owned).collect();
        new.extend(self.page.iter().chain(&self.report).cloned());
        if let Some(file) = self.subject_file() {
            new.extend(self.subject_bake().plan_output(&file, None)?.paths().map(Path::to_owned));
        }
        new.retain(|path| !path.exists() || unfinished.contains(path));
        self.note(new)?;
        let mut job = BakeJob::new([BakeInput::File(self.work.join(SCENE))], self.bake.clone());
        job.photos = Some(photos.clone());
        job.dataset_options = self.dataset_options.clone();
        let of_subject = BakeJob { options: self.subject_bake(), ..job.clone() };
        let mut done = job.save(&self.output, observer)?;
        report.options = done.report.options.clone();
        report.stages.extend(done.report.stages);
        report.outputs.extend(done.report.outputs);
        warn(report, done.report.warnings);
        let subject = match self.subject_file() {
            Some(file) if observer(Event::Part(MakePart::Subject)).is_continue() => {
                match write_subject(of_subject, &file, &mut done.asset, report, observer)? {
                    None => (Some(file), None),
                    why => (None, why),
                }
            }
            _ => (None, None),
        };
        if let Some(page) = &self.page {
            let mut options = BakeOptions::default();
            let planned = options.plan_output(page, None)?;
            let files = planned.start()?;
            output::write(&done.asset, &planned, files, &options.output, report, &mut |_| {
                ControlFlow::Continue(())
            })?;
        }
        Ok(subject)
    }
}

/// Bakes the subject, writes its file, and lets `whole` begin at the photo that shows it best.
/// Returns the reason if there is nothing to write.
fn write_subject(
    mut job: BakeJob,
    file: &Path,
    whole: &mut Asset,
    report: &mut Report,
    observer: Observer<'_>,
) -> Result<Option<&'static str>> {
    let planned = job.options.plan_output(file, None)?;
    let options = job.options.output.clone();
    let done = match job.run(observer) {
        Err(Error::EmptyRegion { .. }) => return Ok(Some("nothing stands out in it")),
        done => done?,
    };
    let share = done.crop.subject_share;
    let is_all =
        !whole.has_backdrop() && 4 * done.asset.mesh.face_count() > 3 * whole.mesh.face_count();
    if is_all {
        return Ok(Some("it is hardly more than its subject"));
    }
    if share.is_none_or(|share| share > MAX_SUBJECT_SHARE) {
        return Ok(Some("what the photos look at is around them, as a room is"));
    }
    output::write(
        &done.asset,
        &planned,
        planned.start()?,
        &options,
        report,
        &mut stages(observer),
    )?;
    if done.viewpoint.photo.is_some() {
        let Provenance { placement, viewpoint, .. } = done.asset.provenance;
        let moved = placement.inverse().then(&whole.provenance.placement);
        whole.provenance.viewpoint = viewpoint.map(|first| moved.viewpoint_to_file(&first));
    }
    warn(report, done.report.warnings);
    Ok(None)
}

/// Add warnings that `report` does not have yet.
fn warn(report: &mut Report, warnings: Vec<String>) {
    for warning in warnings {
        if !report.warnings.contains(&warning) {
            report.warnings.push(warning);
        }
    }
}

fn stored(path: &Path) -> Option<StoredTraining> {
    serde_json::from_str(&input::read_text(path, &Limits::DEFAULT).ok()?).ok()
}

fn save(path: &Path, value: &impl Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value).unwrap_or_default();
    AtomicFile::create(path)?.commit_with(text + "\n").map(drop)
}
