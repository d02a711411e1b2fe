//! A whole run, from a data set or a checkpoint to a trained scene.

use super::backend::{RunSize, TrainBackend};
use super::budget::{BudgetControl, Spending, step_secs};
use super::checkpoint::CheckpointMeta;
use super::cpu::CpuBackend;
use super::device::BackendOptions;
use super::eval::{TrainSample, solid_samples};
use super::options::{REFERENCE_STEPS, TrainOptions, WarmupOptions};
use super::outputs::{Recorder, TrainEvent, TrainObserver};
use super::pyramid::{MIN_PX, size_at};
use super::start::TrainInputs;
use super::trained::{Trained, provenance};
use super::training::Training;
use std::path::PathBuf;
use trisplat_dataset::{Dataset, Photo, View};
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::camera::Camera;
use trisplat_scene::report::generator;
use trisplat_scene::{Error, ImportedScene, Provenance, Result, Soup};

impl<'a> TrainInputs<'a> {
    /// Sets the run up on the CPU, with the first triangles and before the first step.
    ///
    /// # Errors
    ///
    /// Options out of range, no training photos, a checkpoint of another run.
    pub fn start(self) -> Result<Training<'a>> {
        let backend = CpuBackend::new(self.drawing());
        self.start_with(Box::new(backend))
    }

    /// [`TrainInputs::start`] on the device of `place`, or on the CPU with a budget.
    ///
    /// # Errors
    ///
    /// Those of [`TrainInputs::start`]; `gpu` without a matching card, with one that cannot be opened,
    /// or with a budget.
    pub fn start_on(self, place: &BackendOptions) -> Result<Training<'a>> {
        let has_budget =
            self.paced.is_some() || self.resumed().is_some_and(|meta| meta.pace.is_some());
        let place = if has_budget { place.of_budget()? } else { place.clone() };
        let (backend, card, mut warnings) = place.open(self.drawing(), self.size())?;
        let mut training = self.start_with(backend)?;
        warnings.append(&mut training.warnings);
        training.card = card;
        training.warnings = warnings;
        Ok(training)
    }

    /// [`TrainInputs::start`] on a backend with the options of [`TrainInputs::drawing`].
    pub fn start_with(self, backend: Box<dyn TrainBackend + 'a>) -> Result<Training<'a>> {
        Training::new(self, backend)
    }

    fn resumed(&self) -> Option<&CheckpointMeta> {
        self.resume.as_ref().map(|checkpoint| &checkpoint.meta)
    }

    /// The clock of its budget, if it has one.
    pub(super) fn spending(&self) -> Option<Spending> {
        if let Some(paced) = &self.paced {
            return Some(paced.spending);
        }
        let pace = self.resumed()?.pace.as_ref()?;
        let clock = pace.budget.clock;
        let spending = self
            .began
            .map_or_else(|| Spending::new(clock), |began| Spending::of_process(clock, began));
        Some(spending.after(pace.stored_secs))
    }

    /// The first drawing options of this run's backend.
    pub fn drawing(&self) -> SoftOptions {
        let options = self.resumed().map_or(&self.options, |meta| &meta.options);
        options.drawing(self.background)
    }

    /// How large the run becomes.
    fn size(&self) -> RunSize {
        let options = self.resumed().map_or(&self.options, |meta| &meta.options);
        let photos = || self.dataset.train().map(|view| view.photo.size);
        let started = self.part.map_or(0, |part| part.frozen);
        let frozen = self.resumed().map_or(started, |meta| meta.frozen);
        RunSize {
            triangles: options.max_triangles.saturating_add(frozen as u64),
            sh_degree: options.sh_degree,
            photo: photos().max_by_key(|size| size.element_product()).unwrap_or_default(),
            photo_pixels: photos().map(|size| u64::from(size.x) * u64::from(size.y)).sum(),
        }
    }

    /// Runs to the end on the CPU, or until `observer` stops it.
    ///
    /// # Errors
    ///
    /// Those of [`TrainInputs::start`], photos that cannot be decoded. Checkpoints and previews that
    /// cannot be written are in [`Trained::lost`].
    pub fn run(self, observer: TrainObserver<'_>) -> Result<Trained> {
        self.start()?.finish(observer)
    }
}

impl Training<'_> {
    /// Makes the steps, until the last or until `observer` stops it.
    ///
    /// # Errors
    ///
    /// Photos that cannot be decoded, with a checkpoint of all steps so far; a graphics card that
    /// is lost or out of memory, with one of the last densification or checkpoint at least.
    pub fn finish(mut self, observer: TrainObserver<'_>) -> Result<Trained> {
        let mut record = Recorder::new(&self, observer)?;
        let (stopped, last) = self.make_steps(&mut record)?;
        let cpu_secs = record.cpu_secs();
        let scores = record.finish(&mut self, last)?;
        let (provenance, cameras) = self.origin();
        let (soup, not_finite) = self.trained()?;
        let samples = solid_samples(&self.drawing());
        let Self { meta, spending, .. } = self;
        let is_of_now = |(step, _): &(u64, _)| *step == meta.step;
        Ok(Trained {
            checkpoint: record.checkpoint.filter(is_of_now).map(|(_, path)| path),
            soup,
            provenance,
            cameras,
            steps: meta.step,
            options: meta.options,
            paced: meta.pace.zip(spending).map(|(pace, spending)| BudgetControl { pace, spending }),
            curve: meta.curve,
            scores,
            samples,
            photo_size: record.evaluator.shrunk,
            dropped: meta.dropped,
            cpu_secs,
            exposure: meta.exposure.details(),
            stopped,
            lost: record.lost.into_iter().chain(not_finite).collect(),
        })
    }

    /// Makes the steps; returns whether the run was stopped, and its last sample if it made a step.
    fn make_steps(&mut self, record: &mut Recorder<'_>) -> Result<(bool, Option<TrainSample>)> {
        let total = self.options().steps;
        let every = if self.outputs.sample_every == 0 {
            total.div_ceil(100)
        } else {
            self.outputs.sample_every
        };
        let before = self.steps();
        let mut last = None;
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
                    let written = (self.steps() > before).then(|| record.checkpoint(self));
                    return Err(with_remedy(error, written.flatten()));
                }
            }
        }
        Ok((false, last))
    }

    /// True when no step is left.
    fn is_over(&self) -> bool {
        self.is_done() || self.steps() >= self.until_step
    }

    /// Makes a step and the outputs due after it, with a sample after `every` steps; returns its
    /// sample, and whether to stop.
    fn make_step(&mut self, every: u64, record: &mut Recorder<'_>) -> Result<(TrainSample, bool)> {
        let (densified, width_px) = self.step()?;
        let step = self.steps();
        let evaluate_every = self.outputs.evaluate_every;
        let due = |every: u64| every > 0 && step.is_multiple_of(every);
        let is_kept = due(every) || due(evaluate_every);
        let mut now = record.sample(self, width_px, is_kept)?;
        let mut wants_scene = false;
        record.tell(TrainEvent::Step { sample: &now, wants_scene: &mut wants_scene });
        if let Some(densified) = &densified {
            record.tell(TrainEvent::Densified(now.step, densified));
        }
        self.keep_pace(record)?;
        let is_over = self.is_over();
        let most_secs = self.outputs.max_cpu_secs;
        let spent = most_secs > 0.0 && now.cpu_secs >= most_secs;
        let stopped = !is_over && (spent || record.is_asked);
        // `Recorder::finish` keeps and evaluates the last sample.
        if !is_over && is_kept {
            let kept = record.keep(now, self, due(evaluate_every))?;
            if !stopped {
                record.tell(TrainEvent::Sampled(&kept));
            }
        } else if is_over || stopped {
            now = record.sample(self, width_px, true)?;
        }
        if stopped || due(self.outputs.checkpoint_every) {
            record.checkpoint(self);
        }
        record.preview(self);
        if wants_scene {
            let scene = record.uncounted(|_| self.scene())?;
            record.tell(TrainEvent::Scene(&now, Box::new(scene)));
        }
        Ok((now, stopped))
    }

    /// The present scene, as in its file.
    fn scene(&mut self) -> Result<ImportedScene> {
        let (provenance, cameras) = self.origin();
        let (soup, _) = self.trained()?;
        Ok(ImportedScene { provenance, cameras, ..ImportedScene::from(soup) })
    }

    /// The trained triangles, with the shell flagged. Triangles that are no longer finite are left
    /// out and counted in a note.
    ///
    /// # Errors
    ///
    /// Those of [`Training::soup`]; no triangle is left.
    fn trained(&mut self) -> Result<(Soup, Option<String>)> {
        let frozen = self.meta.frozen;
        let pinned = self.meta.pinned;
        let mut soup = self.soup()?.split_off(frozen);
        soup.set_shell(0..pinned - frozen);
        let all = soup.len();
        if all == 0 && self.meta.core.is_none() {
            let reason = "gives a scene without triangles: its photos show nothing in the same place; check their poses";
            return Err(Error::unsupported(&self.dataset.path, reason));
        }
        let gone = soup.retain_finite();
        if gone == all && all > 0 {
            let expected = "lower ones: no triangle has finite numbers any more";
            return Err(Error::invalid("rates", "too high for this scene", expected));
        }
        let lost = (gone > 0).then(|| {
            format!(
                "{gone} of {all} triangles, whose numbers are no longer finite: lower the rates"
            )
        });
        Ok((soup, lost))
    }

    /// Provenance and cameras of the scene; those of its file, if it teaches itself.
    fn origin(&self) -> (Provenance, Vec<Camera>) {
        match self.taught.clone() {
            Some((provenance, cameras)) => {
                let ours = Some(generator());
                (Provenance { generator: ours.clone(), trainer: ours, ..provenance }, cameras)
            }
            None => {
                let exposure =
                    self.meta.exposure.verdict.map(|verdict| verdict.strengths.to_array());
                let provenance = Provenance { exposure, ..provenance(self.dataset) };
                (provenance, self.dataset.train().map(|view| view.camera).collect())
            }
        }
    }

    /// At a milestone, chooses the remaining steps anew.
    fn keep_pace(&mut self, record: &mut Recorder<'_>) -> Result<()> {
        let Some(spending) = self.spending else { return Ok(()) };
        let step = self.steps();
        let triangles = self.triangles() as u64;
        let spent = spending.seconds();
        let is_last = self.options().milestones.last() == Some(&step);
        let reserve = is_last.then(|| record.evaluation_secs(self, &spending)).transpose()?;
        let Some(pace) = &mut self.meta.pace else { return Ok(()) };
        pace.reserve_secs = reserve.or(pace.reserve_secs);
        if let Some(options) = pace.corrected(step, spent, triangles, &self.meta.options) {
            (self.meta.options.steps, self.meta.options.milestones) =
                (options.steps, options.milestones);
            if let Some(correction) = pace.corrections.last() {
                record.tell(TrainEvent::Corrected(correction));
            }
        }
        Ok(())
    }
}

/// The error of a run. If a graphics card failed, it says how to continue from the last checkpoint.
fn with_remedy(error: Error, checkpoint: Option<(u64, PathBuf)>) -> Error {
    match (error, checkpoint) {
        (error @ (Error::Gpu(_) | Error::TooLarge { .. }), Some((step, path))) => Error::Card {
            error: Box::new(error),
            remedy: format!(
                "to continue from step {step}: `backend` cpu `resume` {}",
                path.display()
            ),
        },
        (error, _) => error,
    }
}

/// Photos to measure by, and the seconds and steps that are enough: some clocks advance only every
/// 16 ms.
const MEASURED_PHOTOS: usize = 3;
const MEASURED_SECS: f64 = 0.05;
const MEASURED_STEPS: u64 = 200;

/// Seconds on the budget's clock per second of `step_secs`, by soft steps on photos of half size,
/// which are thrown away.
///
/// # Errors
///
/// Those of [`TrainInputs::start`]; photos that cannot be decoded; a system without CPU time.
pub fn measure_speed(
    dataset: &Dataset,
    from: Option<&ImportedScene>,
    options: &TrainOptions,
    background: [f32; 3],
    spending: &Spending,
) -> Result<f64> {
    let apart = (dataset.train().count() / MEASURED_PHOTOS).max(1);
    let some = dataset.train().step_by(apart).take(MEASURED_PHOTOS);
    let decoded =
        |view: &View| Ok(View { photo: Photo::drawn(view.photo.decode()?), ..view.clone() });
    let dataset = Dataset { views: some.map(decoded).collect::<Result<_>>()?, ..dataset.clone() };
    // Positions of this schedule are steps, so the first ones contain nothing else.
    let steps = REFERENCE_STEPS as u64;
    let warmup = WarmupOptions { quarter_until: 0.0, half_until: REFERENCE_STEPS };
    let options = TrainOptions { steps, milestones: [0; 4], warmup, ..options.clone() };
    let mut run =
        TrainInputs { background, photo_bytes: u64::MAX, ..TrainInputs::new(&dataset, &options) };
    run.from = from.cloned();
    let mut training = run.start()?;
    // The first step allocates.
    training.step()?;
    let before = spending.seconds();
    let mut expected = 0.0;
    let mut taken = 0.0;
    while taken < MEASURED_SECS && training.steps() < MEASURED_STEPS {
        for view in &dataset.views {
            training.step()?;
            let pixels = size_at(view.photo.size, 1, MIN_PX).as_dvec2().element_product();
            expected += step_secs(false, training.triangles() as f64, pixels);
        }
        taken = spending.seconds() - before;
    }
    let wants = "a system that reports CPU time, or `budget_wall`";
    if taken > 0.0 {
        Ok(taken / expected)
    } else {
        Err(Error::invalid("budget", "in CPU time", wants))
    }
}
