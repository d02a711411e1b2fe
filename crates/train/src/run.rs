//! A whole run, from a data set or a checkpoint to a trained scene.

use super::backend::{RunSize, TrainBackend};
use super::budget::{Pace, Paced, Spending};
use super::checkpoint::Checkpoint;
use super::cpu::CpuBackend;
use super::exposure::ExposureDetails;
use super::identity::RunIdentity;
use super::options::TrainOptions;
use super::outputs::{Recorder, RunOptions};
use super::outputs::{TrainEvent, TrainObserver, TrainSample};
use super::start::{FirstScene, Part};
use super::trained::{Trained, provenance};
use super::trainer::Trainer;
use std::path::PathBuf;
use std::time::Instant;
use trisplat_dataset::{Dataset, DatasetKind, DatasetOptions, View};
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::{Error, ImportedScene, Provenance, Result, Soup, camera::Camera, report::generator};

/// All inputs of a run. [`TrainRun::new`] has the plain values; any field can be set before the start.
///
/// ```
/// use std::ops::ControlFlow::Continue;
/// use trisplat_synthetic::SyntheticOptions;
/// use trisplat_dataset::{Dataset, DatasetOptions};
/// use trisplat_train::{RunOptions, TrainOptions, TrainRun, checkpoint};
///
/// let folder = tempfile::tempdir().unwrap();
/// trisplat_synthetic::write(folder.path(), &SyntheticOptions { views: 8, width: 24, points: 50, seed: 0, ..SyntheticOptions::default() })?;
/// let dataset = Dataset::load(folder.path(), &DatasetOptions::default())?;
/// let options = TrainOptions { steps: 20, max_triangles: 100, ..TrainOptions::default() };
///
/// // A run that writes checkpoints ...
/// let path = folder.path().join("scene.checkpoint");
/// let outputs = RunOptions { checkpoint: Some(path.clone()), checkpoint_every: 10, ..RunOptions::default() };
/// let trained = TrainRun { outputs, ..TrainRun::new(&dataset, &options) }.run(&mut |_| Continue(()))?;
///
/// // ... and one that goes on from the last of them: the same bits, since it was made after the last step.
/// let resumed = TrainRun::from_checkpoint(&dataset, checkpoint::read(&path)?).run(&mut |_| Continue(()))?;
/// assert_eq!(trained.soup, resumed.soup);
/// # Ok::<(), trisplat_scene::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct TrainRun<'a> {
    /// The photos; those held out evaluate the scene.
    pub dataset: &'a Dataset,
    /// The options of the training; a resumed run has those of its checkpoint.
    pub options: TrainOptions,
    /// The colour behind everything, sRGB-encoded in [0, 1]; the same as for reading the data set.
    pub background: [f32; 3],
    /// Memory for decoded photos, bytes; others are kept on disk.
    pub photo_bytes: u64,
    /// The outputs during the run.
    pub outputs: RunOptions,
    /// The scene to start from instead of the data set's points, as a reader returns it; suitable options are
    /// those of [`TrainOptions::from_scene`].
    pub from: Option<ImportedScene>,
    /// Whether that scene may have more triangles than `max_triangles`: a solid run cuts it as it goes on, by up to a tenth per
    /// densification, and has some left if it ends before.
    pub cut_from: bool,
    /// The part of that scene to train, if not all; a resumed run has the part of its checkpoint.
    pub part: Option<Part>,
    /// End after this step, without finishing the schedule. `None`: after the last step.
    pub until_step: Option<u64>,
    /// The checkpoint to resume from.
    pub resume: Option<Checkpoint>,
    /// Keeps the run to a budget; `None` makes the steps of the options. A resumed run has the pace of its
    /// checkpoint, and its spending is counted from here.
    pub paced: Option<Paced>,
    /// Start of the process that resumes a run with a budget; `None`: now.
    pub began: Option<Instant>,
    /// Resume even if photos, cameras, points or the background differ from those of the checkpoint.
    pub force_resume: bool,
}

impl<'a> TrainRun<'a> {
    /// A run from its beginning without outputs, with the background and the memory for photos of
    /// [`DatasetOptions::default`].
    pub fn new(dataset: &'a Dataset, options: &TrainOptions) -> Self {
        let run = Self {
            dataset,
            options: options.clone(),
            background: [0.0; 3],
            photo_bytes: 0,
            outputs: RunOptions::default(),
            from: None,
            cut_from: false,
            part: None,
            until_step: None,
            resume: None,
            paced: None,
            began: None,
            force_resume: false,
        };
        run.with_dataset_options(&DatasetOptions::default())
    }

    /// The rest of the run of `checkpoint`.
    pub fn from_checkpoint(dataset: &'a Dataset, checkpoint: Checkpoint) -> Self {
        let run = Self::new(dataset, &checkpoint.meta.options);
        Self { resume: Some(checkpoint), ..run }
    }

    /// With the data set's background and memory for photos.
    pub fn with_dataset_options(self, options: &DatasetOptions) -> Self {
        let photo_bytes = options.photo_bytes();
        Self { background: options.background.to_f32(), photo_bytes, ..self }
    }

    /// Sets the run up on the CPU, with the first triangles and before the first step.
    ///
    /// Errors: options out of range, no training photos, a checkpoint of another run.
    pub fn start(self) -> Result<StartedRun<'a, CpuBackend>> {
        let backend = CpuBackend::new(self.drawing());
        self.start_on(backend)
    }

    /// The first drawing options of this run's backend.
    pub fn drawing(&self) -> SoftOptions {
        let options = self.resume.as_ref().map_or(&self.options, |checkpoint| &checkpoint.meta.options);
        options.drawing(self.background)
    }

    /// Whether the run keeps to a budget, its own or that of its checkpoint.
    pub fn has_budget(&self) -> bool {
        self.paced.is_some() || self.resume.as_ref().is_some_and(|checkpoint| checkpoint.meta.pace.is_some())
    }

    /// How large the run becomes.
    pub fn size(&self) -> RunSize {
        let options = self.resume.as_ref().map_or(&self.options, |checkpoint| &checkpoint.meta.options);
        let photos = || self.dataset.train().map(|view| view.photo.size);
        let started = self.part.map_or(0, |part| part.frozen);
        let frozen = self.resume.as_ref().map_or(started, |checkpoint| checkpoint.meta.frozen);
        RunSize {
            triangles: options.max_triangles.saturating_add(frozen as u64),
            sh_degree: options.sh_degree,
            photo: photos().max_by_key(|size| size.element_product()).unwrap_or_default(),
            photo_pixels: photos().map(|size| u64::from(size.x) * u64::from(size.y)).sum(),
        }
    }

    /// Like [`TrainRun::start`], on a backend with the options of [`TrainRun::drawing`].
    pub fn start_on<B: TrainBackend>(self, backend: B) -> Result<StartedRun<'a, B>> {
        let dataset = self.dataset;
        let (photo_bytes, held_out_bytes) = shares(dataset, self.photo_bytes);
        let drawing = self.drawing();
        let (curve, cpu_secs) = match &self.resume {
            Some(checkpoint) => (checkpoint.meta.curve.clone(), checkpoint.meta.cpu_secs),
            None => (Vec::new(), 0.0),
        };
        // A scene that teaches itself stays in the frame of its file, so its provenance stays true.
        let taught = match &self.from {
            Some(scene) if dataset.kind == DatasetKind::Drawn => {
                Some((scene.provenance.clone(), scene.cameras.clone()))
            }
            _ => None,
        };
        let goes_on = || {
            let pace = self.resume.as_ref()?.meta.pace.clone()?;
            let clock = pace.budget.clock;
            let spending =
                self.began.map_or_else(|| Spending::new(clock), |began| Spending::of_process(clock, began));
            let spending = spending.after(pace.stored_secs());
            Some(Paced { pace, spending })
        };
        let mut paced = self.paced.or_else(goes_on);
        let identity = RunIdentity::of(dataset, self.background, self.from.as_ref());
        let scene = self.from.as_ref().map(|scene| FirstScene { scene, part: self.part, cut: self.cut_from });
        let force = self.force_resume;
        let trainer = match self.resume {
            Some(checkpoint) => Trainer::resume(dataset, checkpoint, identity, force, photo_bytes, backend)?,
            None => Trainer::start(dataset, scene, &self.options, identity, photo_bytes, backend)?,
        };
        if let Some(Paced { pace, spending }) = &mut paced {
            // Pictures of a teacher, the shell, and what a resumed run reads again are no steps.
            pace.resume(spending.seconds());
        }
        Ok(StartedRun {
            trainer,
            paced,
            dataset,
            taught,
            drawing,
            outputs: self.outputs,
            until_step: self.until_step.unwrap_or(u64::MAX),
            curve,
            cpu_secs,
            held_out_bytes,
        })
    }

    /// Runs to the end on the CPU, or until `observer` stops it.
    ///
    /// Errors: those of [`TrainRun::start`], photos that cannot be decoded. Checkpoints and previews that cannot be written are
    /// in [`Trained::lost`].
    pub fn run(self, observer: TrainObserver<'_>) -> Result<Trained> {
        self.start()?.finish(observer)
    }
}

/// The memory for photos, divided between training and held-out photos in proportion to their bytes.
fn shares(dataset: &Dataset, photo_bytes: u64) -> (u64, u64) {
    let bytes = |view: &View| u128::from(view.photo.most_bytes());
    let (train, test): (u128, u128) = (dataset.train().map(bytes).sum(), dataset.test().map(bytes).sum());
    let held_out = u128::from(photo_bytes) * test / (train + test).max(1);
    let held_out = u64::try_from(held_out).unwrap_or(photo_bytes);
    (photo_bytes - held_out, held_out)
}

/// A run that is set up.
#[derive(Debug)]
pub struct StartedRun<'a, B> {
    trainer: Trainer<B>,
    paced: Option<Paced>,
    dataset: &'a Dataset,
    /// Provenance and cameras of the scene that teaches itself.
    taught: Option<(Provenance, Vec<Camera>)>,
    drawing: SoftOptions,
    outputs: RunOptions,
    until_step: u64,
    curve: Vec<TrainSample>,
    cpu_secs: f64,
    /// Memory for the held-out photos.
    held_out_bytes: u64,
}

impl<B: TrainBackend> StartedRun<'_, B> {
    /// The options of the run.
    pub fn options(&self) -> &TrainOptions {
        self.trainer.options()
    }

    /// Steps made before this run resumed.
    pub fn steps(&self) -> u64 {
        self.trainer.steps()
    }

    /// Differences from the inputs of this run's checkpoint, one sentence each.
    pub fn differences(&self) -> &[String] {
        self.trainer.differences()
    }

    /// Triangles in the scene.
    pub fn triangles(&self) -> usize {
        self.trainer.triangles()
    }

    /// The curve before this run resumed.
    pub fn curve(&self) -> &[TrainSample] {
        &self.curve
    }

    /// Makes the steps, until the last or until `observer` stops it.
    ///
    /// Errors: photos that cannot be decoded, with a checkpoint of all steps so far; a graphics card that is
    /// lost or out of memory, with one of the last densification or checkpoint at least.
    pub fn finish(mut self, observer: TrainObserver<'_>) -> Result<Trained> {
        let curve = std::mem::take(&mut self.curve);
        let (spent, bytes) = (self.cpu_secs, self.held_out_bytes);
        let mut record = Recorder::new(self.dataset, self.drawing, curve, spent, bytes, observer)?;
        let (stopped, last) = self.make_steps(&mut record)?;
        let Self { mut trainer, paced, dataset, taught, .. } = self;
        let recorded = record.finish(&mut trainer, last)?;
        let (provenance, cameras) = origin(taught, dataset);
        let (soup, not_finite) = trained(&mut trainer)?;
        let is_of_now = |(step, _): &(u64, _)| *step == trainer.steps();
        Ok(Trained {
            checkpoint: recorded.checkpoint.filter(is_of_now).map(|(_, path)| path),
            soup,
            provenance,
            cameras,
            steps: trainer.steps(),
            options: trainer.options().clone(),
            paced,
            curve: recorded.curve,
            scores: recorded.scores,
            samples: recorded.samples,
            photo_size: recorded.photo_size,
            dropped: trainer.dropped(),
            cpu_secs: recorded.cpu_secs,
            exposure: ExposureDetails::new(
                trainer.exposure(),
                dataset.train().map(|view| view.name.as_str()),
            ),
            stopped,
            lost: recorded.lost.into_iter().chain(not_finite).collect(),
        })
    }

    /// Makes the steps; returns whether the run was stopped, and its last sample if it made a step.
    fn make_steps(&mut self, record: &mut Recorder<'_>) -> Result<(bool, Option<TrainSample>)> {
        let total = self.options().steps;
        let every =
            if self.outputs.sample_every == 0 { total.div_ceil(100) } else { self.outputs.sample_every };
        let (before, mut last) = (self.trainer.steps(), None);
        while !self.is_over() {
            match self.make_step(every, record) {
                Ok((now, stopped)) => {
                    last = Some(now);
                    if stopped {
                        return Ok((true, last));
                    }
                }
                Err(error) => {
                    // A photo that cannot be read loses no step.
                    let written = (self.trainer.steps() > before)
                        .then(|| record.checkpoint(&mut self.trainer, &self.outputs, stored(&self.paced)));
                    return Err(with_remedy(error, written.flatten()));
                }
            }
        }
        Ok((false, last))
    }

    /// True when no step is left.
    fn is_over(&self) -> bool {
        self.trainer.is_done() || self.trainer.steps() >= self.until_step
    }

    /// Makes a step and the outputs due after it, with a sample after `every` steps; returns its sample, and
    /// whether to stop.
    fn make_step(&mut self, every: u64, record: &mut Recorder<'_>) -> Result<(TrainSample, bool)> {
        let outcome = self.trainer.step()?;
        let Self { trainer, paced, outputs, .. } = self;
        let step = trainer.steps();
        let due = |every: u64| every > 0 && step.is_multiple_of(every);
        let is_kept = due(every) || due(outputs.evaluate_every);
        let mut now = record.sample(trainer, outcome.width_px, is_kept)?;
        let mut wants_scene = false;
        record.tell(TrainEvent::Step { sample: &now, wants_scene: &mut wants_scene });
        if let Some(densified) = &outcome.densified {
            record.tell(TrainEvent::Densified(now.step, densified));
        }
        keep_pace(trainer, paced.as_mut(), record)?;
        trainer.find_exposures(&self.drawing)?;
        let is_over = self.is_over();
        let Self { trainer, paced, outputs, .. } = self;
        let spent = outputs.max_cpu_secs > 0.0 && now.cpu_secs >= outputs.max_cpu_secs;
        let stopped = !is_over && (spent || record.is_asked);
        // `Recorder::finish` keeps and evaluates the last sample.
        if !is_over && is_kept {
            let kept = record.keep(now, trainer, due(outputs.evaluate_every))?;
            if !stopped {
                record.tell(TrainEvent::Sampled(&kept));
            }
        } else if is_over || stopped {
            now = record.sample(trainer, outcome.width_px, true)?;
        }
        if stopped || due(outputs.checkpoint_every) {
            record.checkpoint(trainer, outputs, stored(paced));
        }
        record.preview(trainer, outputs);
        if wants_scene {
            let scene = record.uncounted(|_| self.scene())?;
            record.tell(TrainEvent::Scene(&now, Box::new(scene)));
        }
        Ok((now, stopped))
    }

    /// The present scene, as in its file.
    fn scene(&mut self) -> Result<ImportedScene> {
        let (provenance, cameras) = origin(self.taught.clone(), self.dataset);
        let (soup, _) = trained(&mut self.trainer)?;
        Ok(ImportedScene { provenance, cameras, ..ImportedScene::from(soup) })
    }
}

/// The trained triangles, with the shell flagged. Triangles that are no longer finite are left out and
/// counted in a note.
///
/// Errors: those of [`Trainer::soup`]; no triangle is left.
fn trained<B: TrainBackend>(trainer: &mut Trainer<B>) -> Result<(Soup, Option<String>)> {
    let (frozen, shell) = (trainer.frozen(), trainer.shell());
    let mut soup = trainer.soup()?.split_off(frozen);
    soup.set_shell(0..shell);
    let all = soup.len();
    let gone = soup.retain_finite();
    if gone == all && all > 0 {
        let expected = "lower ones: no triangle has finite numbers any more";
        return Err(Error::invalid("rates", "too high for this scene", expected));
    }
    let lost = (gone > 0)
        .then(|| format!("{gone} of {all} triangles, whose numbers are no longer finite: lower the rates"));
    Ok((soup, lost))
}

/// The error of a run. If a graphics card failed, it says how to continue from the last checkpoint.
fn with_remedy(error: Error, checkpoint: Option<(u64, PathBuf)>) -> Error {
    match (error, checkpoint) {
        (error @ (Error::Gpu(_) | Error::TooLarge { .. }), Some((step, path))) => Error::Card {
            error: Box::new(error),
            remedy: format!("to continue from step {step}: `backend` cpu `resume` {}", path.display()),
        },
        (error, _) => error,
    }
}

/// Provenance and cameras of the scene; those of its file, if it teaches itself.
fn origin(taught: Option<(Provenance, Vec<Camera>)>, dataset: &Dataset) -> (Provenance, Vec<Camera>) {
    match taught {
        Some((provenance, cameras)) => {
            let ours = Some(generator());
            (Provenance { generator: ours.clone(), trainer: ours, ..provenance }, cameras)
        }
        None => (provenance(dataset), dataset.train().map(|view| view.camera).collect()),
    }
}

/// At a milestone, chooses the remaining steps anew.
fn keep_pace<B: TrainBackend>(
    trainer: &mut Trainer<B>,
    paced: Option<&mut Paced>,
    record: &mut Recorder<'_>,
) -> Result<()> {
    let Some(Paced { pace, spending }) = paced else { return Ok(()) };
    let (step, triangles) = (trainer.steps(), trainer.triangles() as u64);
    let spent = spending.seconds();
    if trainer.options().milestones.last() == Some(&step) {
        pace.reserve(record.evaluation_secs(trainer, spending)?);
    }
    if let Some(options) = pace.corrected(step, spent, triangles, trainer.options()) {
        trainer.stretch(&options);
        if let Some(correction) = pace.corrections.last() {
            record.tell(TrainEvent::Corrected(correction));
        }
    }
    Ok(())
}

/// The state of the budget for a checkpoint.
fn stored(paced: &Option<Paced>) -> Option<Pace> {
    paced.as_ref().map(|paced| paced.pace.stored(paced.spending.seconds()))
}
