//! A training: photos in a random order, one step per photo, densifications between them, and
//! samples, evaluations and checkpoints on the way.

mod run;
mod scene;

use super::backend::{PhotoId, StepPhoto, StepStats, TrainBackend};
use super::checkpoint::{Checkpoint, CheckpointMeta};
use super::cpu::CpuBackend;
use super::densify::{self, Densified, densify};
use super::device::BackendOptions;
use super::eval::TrainSample;
use super::identity::{RunIdentity, differences};
use super::initial::initial_checkpoint;
use super::inputs::{TrainInputs, TrainOutputs};
use super::options::TrainOptions;
use super::params::OptimizerState;
use super::pyramid::{MIN_PX, Pyramid, order};
use super::recorder::TrainObserver;
use super::schedule::Schedule;
use super::stereo::DepthAnchors;
use super::trained::Trained;
use super::visibility::VisibilityStats;
use glam::Vec3;
use std::sync::Arc;
use trisplat_dataset::{Dataset, DatasetKind, View};
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::camera::Camera;
use trisplat_scene::report::generator;
use trisplat_scene::{Error, ImportedScene, Provenance, Result, Rng, SceneNormalization, Spending};

/// A training between two steps. It is a pure function of the data set, the options and the steps
/// made: stopping, writing a checkpoint and resuming elsewhere changes no bit.
#[derive(Debug)]
pub struct Training<'a> {
    /// The device's card, graphics API, driver and needed memory; `None` on the CPU.
    pub card: Option<String>,
    /// Notes for the user about the device, and differences from the inputs of the checkpoint.
    pub warnings: Vec<String>,
    /// The state that is not in arrays.
    pub(super) meta: CheckpointMeta,
    /// The clock of the budget, if the run has one.
    pub(super) spending: Option<Spending>,
    pub(super) dataset: &'a Dataset,
    /// Provenance and cameras of a scene that teaches itself.
    own_origin: Option<(Provenance, Vec<Camera>)>,
    pub(super) drawing: SoftOptions,
    pub(super) outputs: TrainOutputs,
    pub(super) until_step: u64,
    /// Memory for the held-out photos.
    pub(super) held_out_bytes: u64,
    /// Depth anchors, once the scene is solid.
    anchors: Option<DepthAnchors>,
    /// The cameras, in training space.
    cameras: Vec<Camera>,
    photos: Pyramid,
    order: Vec<usize>,
    backend: Box<dyn TrainBackend + 'a>,
    visibility: VisibilityStats,
    /// Figures of steps that no sample contains yet.
    figures: Vec<StepStats>,
    /// Data of the last state given to the backend, if the backend can lose it.
    loaded: Option<LoadedAt>,
    level: u32,
    /// Size of a pixel at this level, in pixels of the full photo.
    full_px: f32,
}

/// The step at which the backend was given a state, and the other data for a checkpoint of that
/// moment.
#[derive(Debug, Clone)]
struct LoadedAt {
    step: u64,
    dropped: u64,
    visibility: VisibilityStats,
}

impl<'a> TrainInputs<'a> {
    /// Starts the training on the CPU: creates the first triangles, and makes no step.
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
    /// As [`TrainInputs::start`]; `gpu` without a matching card, with one that cannot be
    /// opened, or with a budget.
    pub fn start_on(self, place: &BackendOptions) -> Result<Training<'a>> {
        let has_budget =
            self.budget_control.is_some() || self.resumed().is_some_and(|meta| meta.pace.is_some());
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

    /// Trains to the end on the CPU, or until `observer` stops it.
    ///
    /// # Errors
    ///
    /// As [`TrainInputs::start`]; photos that cannot be decoded. Checkpoints and previews
    /// that cannot be written are in [`Trained::lost`].
    pub fn run(self, observer: TrainObserver<'_>) -> Result<Trained> {
        self.start()?.finish(observer)
    }
}

impl<'a> Training<'a> {
    /// Prepares a training on a backend with the options of [`TrainInputs::drawing`]: from its
    /// checkpoint, the triangles of a scene, all or a part of them, or the points of the data set.
    /// Photos that a resumed run has used are decoded here, once.
    ///
    /// # Errors
    ///
    /// Options out of range, no training photos, a scene of more triangles than the options permit;
    /// a checkpoint with training photos of other names or, unless forced, any other difference.
    pub(super) fn new(
        mut inputs: TrainInputs<'a>,
        backend: Box<dyn TrainBackend + 'a>,
    ) -> Result<Self> {
        let dataset = inputs.dataset;
        let drawing = inputs.drawing();
        let (photo_bytes, held_out_bytes) = divide_photo_bytes(dataset, inputs.photo_bytes);
        let views: Vec<&View> = dataset.train().collect();
        if views.is_empty() {
            return Err(Error::invalid(
                "data set",
                "0 training photos",
                "one or more; see `test_every`",
            ));
        }
        let identity = RunIdentity::of(dataset, inputs.background, inputs.from.as_ref());
        let mut photos = Pyramid::new(&views, photo_bytes, MIN_PX);
        let spending = inputs.spending();
        let (checkpoint, warnings) = match inputs.resume.take() {
            Some(checkpoint) => resume(checkpoint, identity, &mut photos, inputs.force_resume)?,
            None => {
                inputs.options.validate()?;
                let checkpoint = initial_checkpoint(&views, &inputs, identity, &mut photos)?;
                (checkpoint, Vec::new())
            }
        };
        let Checkpoint { state, visibility, mut meta } = checkpoint;
        meta.pace = inputs.budget_control.map(|control| control.pace).or(meta.pace);
        if let (Some(pace), Some(spending)) = (&mut meta.pace, &spending) {
            // Pictures of a teacher, the shell, and reading a checkpoint again are no steps.
            pace.resume(spending.seconds());
        }
        // A scene that teaches itself stays in the frame of its file, so its provenance stays true.
        let own = |scene: ImportedScene| (dataset.kind == DatasetKind::Drawn).then_some(scene);
        let own_origin = inputs.from.and_then(own).map(|scene| (scene.provenance, scene.cameras));
        let space = meta.space();
        let mut training = Self {
            card: None,
            warnings,
            spending,
            dataset,
            own_origin,
            drawing,
            outputs: inputs.outputs,
            until_step: inputs.until_step.unwrap_or(u64::MAX),
            held_out_bytes,
            anchors: None,
            cameras: views.iter().map(|v| space.camera_to_training(&v.camera)).collect(),
            photos,
            order: Vec::new(),
            backend,
            visibility,
            figures: Vec::new(),
            loaded: None,
            level: Schedule::new(&meta.options).level(meta.step),
            full_px: 1.0,
            meta,
        };
        training.load(state)?;
        training.plan_epoch();
        Ok(training)
    }

    /// Moves a state into the backend.
    fn load(&mut self, state: OptimizerState) -> Result<()> {
        if self.backend.can_be_lost() {
            let visibility = self.visibility.clone();
            self.loaded =
                Some(LoadedAt { step: self.meta.step, dropped: self.meta.dropped, visibility });
        }
        self.backend.load(state)
    }

    /// Steps made.
    pub fn steps(&self) -> u64 {
        self.meta.step
    }

    /// True when all steps are made.
    pub(super) fn is_done(&self) -> bool {
        self.meta.step >= self.meta.options.steps
    }

    /// The options of the run.
    pub fn options(&self) -> &TrainOptions {
        &self.meta.options
    }

    /// The curve so far.
    pub fn curve(&self) -> &[TrainSample] {
        &self.meta.curve
    }

    /// Triangles in the scene.
    pub fn triangles(&self) -> usize {
        self.backend.len()
    }

    /// Figures of finished steps, each once, in the order of the steps; with `all`, it waits for
    /// unfinished ones.
    pub(super) fn figures(&mut self, all: bool) -> Result<Vec<StepStats>> {
        self.collect_figures(all)?;
        Ok(std::mem::take(&mut self.figures))
    }

    fn collect_figures(&mut self, all: bool) -> Result<()> {
        let figures = self.backend.figures(all)?;
        self.meta.dropped += figures.iter().map(|stats| stats.dropped).sum::<u64>();
        self.figures.extend(figures);
        Ok(())
    }

    /// Training space.
    pub(super) fn space(&self) -> SceneNormalization {
        self.meta.space()
    }

    /// Makes one step, and the densification that follows it, if one is due; returns the width of
    /// the photo, px, too.
    pub(super) fn step(&mut self) -> Result<(Option<Densified>, u32)> {
        let count = self.cameras.len() as u64;
        if self.meta.step.is_multiple_of(count) {
            self.plan_epoch();
        }
        let index = self.order[(self.meta.step % count) as usize];
        let level = Schedule::new(&self.meta.options).level(self.meta.step);
        let mut pixels = self.photos.take(index, level)?;
        let mut rates = Schedule::new(&self.meta.options).rates(self.meta.step);
        let mut id = None;
        if self.photos.is_cut(index) && pixels.alpha.is_some() {
            // With only one background, triangles of its colour would pass for background.
            let behind = random_background(self.meta.options.seed, self.meta.step);
            pixels = Arc::new(pixels.recomposited(behind));
            rates.background = Some(behind.map(|c| f32::from(c) / 255.0));
        } else {
            let corrected;
            (pixels, corrected) = self.meta.exposure.correct(index, pixels);
            id = Some(PhotoId { index, level, corrected });
        }
        let camera = self.cameras[index].resized(pixels.size);
        if level != self.level {
            // The visibility so far was measured at another size.
            self.collect_visibility()?;
            self.level = level;
        }
        self.full_px = self.photos.size(index, 0).x as f32 / pixels.size.x as f32;
        let first = self.visibility.record_photo(index);
        let photo = StepPhoto { camera: &camera, pixels: &pixels, first, id };
        if let Err(error) = self.backend.step(&photo, &rates) {
            // The photo was not drawn.
            self.visibility.drawn[index] = !first;
            return Err(error);
        }
        self.meta.step += 1;
        let densified = if Schedule::new(&self.meta.options).densifies_after(self.meta.step) {
            Some(self.densify()?)
        } else {
            None
        };
        Ok((densified, pixels.size.x))
    }

    fn densify(&mut self) -> Result<Densified> {
        self.collect_visibility()?;
        self.measure_anchors()?;
        let o = &self.meta.options;
        let schedule = Schedule::new(&self.meta.options);
        // Pruning uses the last drawing of the scene.
        let last = self.meta.step - 1;
        let eyes: Vec<Vec3> = self.cameras.iter().map(Camera::position).collect();
        let plan = densify::DensifyPlan {
            options: &o.densify,
            eyes: &eyes,
            anchors: self.anchors.as_ref().filter(|anchors| !anchors.is_empty()),
            max_triangles: usize::try_from(o.max_triangles).unwrap_or(usize::MAX),
            core: self.meta.core,
            grow: schedule.grows_after(self.meta.step),
            pull: schedule.pulls_after(self.meta.step),
            prune_weight: schedule.prune_weight(last) as f32,
            prune_opacity: schedule.prune_opacity(last),
            densification: schedule.densification(self.meta.step),
            bisect: schedule.is_opaque(last),
            anneal: schedule.anneal(last),
            seed: o.seed,
            step: self.meta.step,
        };
        let mut state = self.backend.store()?;
        let densified = densify(&mut state, &mut self.visibility, &plan);
        self.load(state)?;
        Ok(densified)
    }

    /// Measures the depth anchors at the first densification of a solid scene; parts of scenes have
    /// none.
    fn measure_anchors(&mut self) -> Result<()> {
        let options = &self.meta.options;
        let schedule = Schedule::new(&self.meta.options);
        let due = schedule.is_opaque(self.meta.step - 1) && self.meta.core.is_none();
        if due && self.anchors.is_none() {
            // A resumed run sees the same pictures, though its own may be larger by now.
            let level = schedule.level(schedule.scaled(options.solid.opacity_until));
            let space = self.space();
            let max_triangles = options.max_triangles;
            let cameras = &self.cameras;
            let photos = &mut self.photos;
            self.anchors = Some(DepthAnchors::new(
                self.dataset,
                &space,
                cameras,
                photos,
                level,
                max_triangles,
            )?);
        }
        Ok(())
    }

    /// Moves the visibility of the last steps out of the backend.
    fn collect_visibility(&mut self) -> Result<()> {
        let recent = self.backend.take_visibility()?;
        for (importance, is_first) in [(&recent.first, true), (&recent.again, false)] {
            if importance.max_weight.len() == self.visibility.len() {
                self.visibility.merge(importance, is_first, self.full_px);
            }
        }
        self.visibility.add_errors(&recent.error);
        Ok(())
    }

    /// Shuffles the photos for the epoch that holds the next step.
    fn plan_epoch(&mut self) {
        let count = self.cameras.len();
        let epoch = self.meta.step / count as u64;
        self.order = order(count, self.meta.options.seed, epoch);
        let level = Schedule::new(&self.meta.options).level(self.meta.step);
        let left = &self.order[(self.meta.step % count as u64) as usize..];
        self.photos.prefetch(left, level);
    }

    /// Everything needed to resume elsewhere. If the backend has lost the scene, this is the state
    /// it was last loaded with, after a densification or a checkpoint.
    ///
    /// # Errors
    ///
    /// The backend has lost the scene, and there is no earlier one.
    pub(super) fn checkpoint(&mut self, cpu_secs: f64) -> Result<Checkpoint> {
        let (state, now) = match self.take_state() {
            Ok(state) => {
                // A backend that cannot take the state back fails at the next step; this is the
                // state before that step.
                let _ = self.load(state.clone());
                let visibility = self.visibility.clone();
                (state, LoadedAt { step: self.meta.step, dropped: self.meta.dropped, visibility })
            }
            Err(error) => match (self.backend.rescued(), &self.loaded) {
                (Some(state), Some(loaded)) => (state, loaded.clone()),
                _ => return Err(error),
            },
        };
        let mut meta =
            CheckpointMeta { step: now.step, dropped: now.dropped, cpu_secs, ..self.meta.clone() };
        meta.generator = generator();
        meta.curve.retain(|sample| sample.step <= now.step);
        for (i, photo) in meta.identity.photos.iter_mut().enumerate() {
            photo.pixels = self.photos.digest(i);
        }
        if let (Some(pace), Some(spending)) = (&mut meta.pace, &self.spending) {
            pace.stored_secs = spending.seconds();
        }
        Ok(Checkpoint { state, visibility: now.visibility, meta })
    }

    /// Moves the state and its data out of the backend.
    fn take_state(&mut self) -> Result<OptimizerState> {
        self.collect_visibility()?;
        self.collect_figures(true)?;
        self.backend.store()
    }
}

/// Continues `checkpoint` with the inputs of `identity`; returns warnings about their differences
/// too.
///
/// # Errors
///
/// As [`differences`].
fn resume(
    mut checkpoint: Checkpoint,
    identity: RunIdentity,
    photos: &mut Pyramid,
    force: bool,
) -> Result<(Checkpoint, Vec<String>)> {
    let before = std::mem::replace(&mut checkpoint.meta.identity, identity);
    let differences = differences(&before, &checkpoint.meta.identity, photos, force)?;
    let warnings = differences.map(|difference| format!("resumed although {difference}")).collect();
    Ok((checkpoint, warnings))
}

/// The random background of an object at a step, sRGB-encoded: each channel is 0 or 255. Colours
/// between are nearer to the object's, and so tell less about its outline: files are up to 0.5 dB
/// worse with them (docs/benchmarks/figures.md).
fn random_background(seed: u64, step: u64) -> [u8; 3] {
    let rng = Rng::new(seed, "background", step);
    [0, 1, 2].map(|channel| if rng.uniform(channel) < 0.5 { 0 } else { 255 })
}

/// The memory for photos, divided between training and held-out photos in proportion to their
/// bytes.
fn divide_photo_bytes(dataset: &Dataset, photo_bytes: u64) -> (u64, u64) {
    let bytes = |view: &View| u128::from(view.photo.most_bytes());
    let (train, test): (u128, u128) =
        (dataset.train().map(bytes).sum(), dataset.test().map(bytes).sum());
    let held_out = u128::from(photo_bytes) * test / (train + test).max(1);
    let held_out = u64::try_from(held_out).unwrap_or(photo_bytes);
    (photo_bytes - held_out, held_out)
}
