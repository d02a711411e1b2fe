//! One run: photos in a random order, one step per photo, densifications between them.

use super::backend::{PhotoId, StepPhoto, StepStats, TrainBackend};
use super::checkpoint::{Checkpoint, CheckpointMeta};
use super::densify::{self, Densified, densify};
use super::eval::{TrainSample, solid_samples};
use super::identity::RunIdentity;
use super::known::KnownDepth;
use super::options::TrainOptions;
use super::params::{Anneal, OptimizerState};
use super::pyramid::{MIN_PX, Pyramid, order};
use super::schedule::Schedule;
use super::start::{self, TrainInputs, TrainOutputs};
use super::visibility::VisibilityStats;
use glam::Vec3;
use std::sync::Arc;
use trisplat_dataset::{Dataset, DatasetKind, View};
use trisplat_raster::soft::{SoftOptions, Window};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::report::generator;
use trisplat_scene::{
    Error, ImportedScene, Provenance, Result, Rng, SceneNormalization, Soup, Spending,
};

/// A run between two steps. A pure function of the data set, the options and the steps made:
/// stopping, writing a checkpoint and resuming elsewhere changes no bit.
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
    /// Provenance and cameras of the scene that teaches itself.
    pub(super) taught: Option<(Provenance, Vec<Camera>)>,
    pub(super) drawing: SoftOptions,
    pub(super) outputs: TrainOutputs,
    pub(super) until_step: u64,
    /// Memory for the held-out photos.
    pub(super) held_out_bytes: u64,
    /// Surfaces whose place is known, once the scene is solid.
    known: Option<KnownDepth>,
    /// The cameras, in training space.
    cameras: Vec<Camera>,
    photos: Pyramid,
    order: Vec<usize>,
    backend: Box<dyn TrainBackend + 'a>,
    visibility: VisibilityStats,
    /// Figures that were not read yet.
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

impl<'a> Training<'a> {
    /// Sets `run` up on a backend with the options of [`TrainInputs::drawing`]: from its checkpoint,
    /// the triangles of a scene, all or a part of them, or the points of the data set. Photos that
    /// a resumed run has used are decoded here, once.
    ///
    /// # Errors
    ///
    /// Options out of range, no training photos, a scene of more triangles than the options permit;
    /// a checkpoint with training photos of other names or, unless forced, any other difference.
    pub(super) fn new(
        mut run: TrainInputs<'a>,
        backend: Box<dyn TrainBackend + 'a>,
    ) -> Result<Self> {
        let dataset = run.dataset;
        let drawing = run.drawing();
        let (photo_bytes, held_out_bytes) = shares(dataset, run.photo_bytes);
        let views: Vec<&View> = dataset.train().collect();
        if views.is_empty() {
            return Err(Error::invalid(
                "data set",
                "0 training photos",
                "one or more; see `test_every`",
            ));
        }
        let identity = RunIdentity::of(dataset, run.background, run.from.as_ref());
        let mut photos = Pyramid::new(&views, photo_bytes, MIN_PX);
        let spending = run.spending();
        let mut warnings = Vec::new();
        let Checkpoint { state, visibility, mut meta } = match run.resume.take() {
            Some(mut checkpoint) => {
                let before = std::mem::replace(&mut checkpoint.meta.identity, identity);
                let differences =
                    differences(&before, &checkpoint.meta.identity, &mut photos, run.force_resume)?;
                warnings = differences
                    .map(|difference| format!("resumed although {difference}"))
                    .collect();
                checkpoint
            }
            None => {
                run.options.validate()?;
                start::first(&views, &run, identity, &mut photos)?
            }
        };
        meta.pace = run.paced.map(|paced| paced.pace).or(meta.pace);
        if let (Some(pace), Some(spending)) = (&mut meta.pace, &spending) {
            // Pictures of a teacher, the shell, and what a resumed run reads again are no steps.
            pace.resume(spending.seconds());
        }
        // A scene that teaches itself stays in the frame of its file, so its provenance stays true.
        let own = |scene: ImportedScene| (dataset.kind == DatasetKind::Drawn).then_some(scene);
        let taught = run.from.and_then(own).map(|scene| (scene.provenance, scene.cameras));
        let space = meta.space();
        let mut training = Self {
            card: None,
            warnings,
            spending,
            dataset,
            taught,
            drawing,
            outputs: run.outputs,
            until_step: run.until_step.unwrap_or(u64::MAX),
            held_out_bytes,
            known: None,
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

    /// Gives the present state to the backend.
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

    /// How to draw the present scene: with the window, order and alpha cap of the last step.
    pub(super) fn drawing(&self) -> SoftOptions {
        let last = self.meta.step.max(1) - 1;
        let rates = Schedule::new(&self.meta.options).rates(last);
        let window = Window::Coverage { width_px: 1.0 };
        if self.ends_solid() {
            SoftOptions { window, ..self.drawing }
        } else {
            rates.drawing(&self.drawing)
        }
    }

    /// True where [`Training::picture`] draws faster than the CPU: soft pictures of the whole scene
    /// on a graphics card.
    pub(super) fn draws(&self, drawing: &SoftOptions) -> bool {
        self.backend.draws()
            && self.meta.frozen == 0
            && solid_samples(drawing).is_none()
            && !self.ends_solid()
    }

    /// The view of `camera`, in the world, of the present scene.
    ///
    /// # Errors
    ///
    /// Those of the backend; it does not draw.
    pub(super) fn picture(&mut self, camera: &Camera, drawing: &SoftOptions) -> Result<RgbImage> {
        let rates = Schedule::new(&self.meta.options).rates(self.meta.step.max(1) - 1);
        let camera = self.space().camera_to_training(camera);
        Ok(self.backend.picture(&camera, drawing, &rates)?.to_pixels())
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
            let behind = background(self.meta.options.seed, self.meta.step);
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
            // It was not drawn.
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
        self.find_known_depth()?;
        let o = &self.meta.options;
        let schedule = Schedule::new(&self.meta.options);
        // Pruning uses the last drawing of the scene.
        let last = self.meta.step - 1;
        let eyes: Vec<Vec3> = self.cameras.iter().map(Camera::position).collect();
        let plan = densify::DensifyPlan {
            options: &o.densify,
            eyes: &eyes,
            known: self.known.as_ref().filter(|known| !known.is_empty()),
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

    /// Finds the surfaces whose place is known, at the first densification of a solid scene; parts
    /// of scenes have none.
    fn find_known_depth(&mut self) -> Result<()> {
        let options = &self.meta.options;
        let schedule = Schedule::new(&self.meta.options);
        let due = schedule.is_opaque(self.meta.step - 1) && self.meta.core.is_none();
        if due && self.known.is_none() {
            // A resumed run sees the same pictures, though its own may be larger by now.
            let level = schedule.level(schedule.scaled(options.solid.opacity_until));
            let space = self.space();
            let most = options.max_triangles;
            let cameras = &self.cameras;
            let photos = &mut self.photos;
            self.known = Some(KnownDepth::of(self.dataset, &space, cameras, photos, level, most)?);
        }
        Ok(())
    }

    /// Moves the visibility of the last steps out of the backend.
    fn collect_visibility(&mut self) -> Result<()> {
        let recent = self.backend.take_visibility()?;
        for (seen, counts) in [(&recent.first, true), (&recent.again, false)] {
            if seen.max_weight.len() == self.visibility.len() {
                self.visibility.merge(seen, counts, self.full_px);
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

    /// The present scene, in the data set's world.
    pub(super) fn soup(&mut self) -> Result<Soup> {
        let schedule = Schedule::new(&self.meta.options);
        let last = self.meta.step.max(1) - 1;
        let (anneal, degree) = if self.ends_solid() {
            (Anneal::SOLID, 0)
        } else {
            (schedule.anneal(last), schedule.sh_degree(last))
        };
        let mut soup = self.backend.params()?.to_soup(&anneal, degree);
        self.space().soup_to_world(&mut soup);
        Ok(soup)
    }

    /// True when the run is over and its triangles are opaque from now on.
    fn ends_solid(&self) -> bool {
        self.is_done() && self.meta.options.ends_solid()
    }

    /// Everything needed to resume elsewhere. If the backend has lost the scene, this is the state
    /// that it was last given, after a densification or a checkpoint.
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

/// The background of an object at a step, sRGB-encoded: each channel is 0 or 255. Colours between
/// are nearer to the object's, and so tell less about where it ends: files are up to 0.5 dB worse
/// with them (docs/benchmarks/figures.md).
fn background(seed: u64, step: u64) -> [u8; 3] {
    let rng = Rng::new(seed, "background", step);
    [0, 1, 2].map(|channel| if rng.uniform(channel) < 0.5 { 0 } else { 255 })
}

/// The memory for photos, divided between training and held-out photos in proportion to their
/// bytes.
fn shares(dataset: &Dataset, photo_bytes: u64) -> (u64, u64) {
    let bytes = |view: &View| u128::from(view.photo.most_bytes());
    let (train, test): (u128, u128) =
        (dataset.train().map(bytes).sum(), dataset.test().map(bytes).sum());
    let held_out = u128::from(photo_bytes) * test / (train + test).max(1);
    let held_out = u64::try_from(held_out).unwrap_or(photo_bytes);
    (photo_bytes - held_out, held_out)
}

/// Differences of the inputs `now` from those of a checkpoint, one sentence each. Photos that its
/// run has used are decoded.
///
/// # Errors
///
/// Photos of other names; without `force`, any difference; photos that cannot be decoded.
fn differences(
    before: &RunIdentity,
    now: &RunIdentity,
    photos: &mut Pyramid,
    force: bool,
) -> Result<impl Iterator<Item = String> + use<>> {
    if !now.photos.iter().map(|photo| &photo.name).eq(before.photos.iter().map(|photo| &photo.name))
    {
        let value = format!("of {} other photos", before.photos.len());
        return Err(Error::invalid(
            "resume",
            value,
            "a checkpoint of this data set with this split",
        ));
    }
    let checked = |difference: Option<String>| match difference.filter(|_| !force) {
        Some(difference) => {
            let wants =
                "the photos and options of its run, or `force_resume` to continue with others";
            Err(Error::invalid("resume", format!("of another run: {difference}"), wants))
        }
        None => Ok(()),
    };
    let inputs = before.difference(now);
    checked(inputs.clone())?;
    let known = before.photos.iter().enumerate().filter_map(|(i, photo)| Some((i, photo.pixels?)));
    let changed = photos.first_changed(&known.collect::<Vec<_>>())?;
    let pixels = changed.map(|i| {
        let name = &before.photos[i].name;
        format!("its photo {name} has other pixels (`masks` and `background` count too)")
    });
    checked(pixels.clone())?;
    Ok(inputs.into_iter().chain(pixels))
}
