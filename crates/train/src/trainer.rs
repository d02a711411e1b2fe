//! One run: photos in a random order, one step per photo, densifications between them.

use super::backend::{PhotoId, StepPhoto, StepStats, TrainBackend};
use super::checkpoint::{Checkpoint, CheckpointMeta};
use super::densify::{self, Densified, densify};
use super::eval::{EvalScene, solid_samples};
use super::exposure::ExposureEstimates;
use super::identity::RunIdentity;
use super::options::TrainOptions;
use super::outputs::TrainSample;
use super::params::{Anneal, TrainState};
use super::pyramid::{MIN_PX, Pyramid, order};
use super::schedule::Schedule;
use super::start::Core;
use super::start::{self, FirstScene, Position};
use super::visibility::{PhotoVisibility, VisibilityStats};
use std::sync::Arc;
use trisplat_dataset::{
    Dataset, View,
    exposure::{Cells, compared_size},
};
use trisplat_raster::{
    soft::{SoftOptions, SoftRasterizer, Window},
    solid::SolidRasterizer,
};
use trisplat_scene::{Error, Result, Rng, SceneNormalization, Soup, camera::Camera, image::RgbImage};

/// A run between two steps. A pure function of the data set, the options and the steps made: stopping,
/// writing a checkpoint and resuming elsewhere changes no bit.
#[derive(Debug)]
pub struct Trainer<B> {
    options: TrainOptions,
    space: SceneNormalization,
    /// The cameras, in training space.
    cameras: Vec<Camera>,
    identity: RunIdentity,
    /// Differences from the inputs of the checkpoint.
    differences: Vec<String>,
    photos: Pyramid,
    /// The photos' exposures.
    exposure: ExposureEstimates,
    order: Vec<usize>,
    backend: B,
    visibility: VisibilityStats,
    step: u64,
    dropped: u64,
    /// Figures that were not read yet.
    figures: Vec<StepStats>,
    pinned: usize,
    frozen: usize,
    core: Option<Core>,
    /// Data of the last state given to the backend, if the backend can lose it.
    loaded: Option<LoadedAt>,
    level: u32,
    /// Size of a pixel at this level, in pixels of the full photo.
    full_px: f32,
}

/// The step at which the backend was given a state, and the other data for a checkpoint of that moment.
#[derive(Debug, Clone)]
struct LoadedAt {
    step: u64,
    dropped: u64,
    visibility: VisibilityStats,
}

/// What [`Trainer::step`] did.
#[derive(Debug, Clone, Copy)]
pub struct StepOutcome {
    /// The densification after the step, if one was due.
    pub densified: Option<Densified>,
    /// Width of the photo, px.
    pub width_px: u32,
}

impl<B: TrainBackend> Trainer<B> {
    /// A run from its beginning: from the triangles of `scene`, all or a part of them, or from the points of
    /// the data set. `identity` describes the inputs of the run; `photo_bytes` is the memory for decoded
    /// photos.
    ///
    /// Errors: options out of range, no training photos, a scene of more triangles than the options permit.
    pub fn start(
        dataset: &Dataset,
        scene: Option<FirstScene<'_>>,
        options: &TrainOptions,
        identity: RunIdentity,
        photo_bytes: u64,
        backend: B,
    ) -> Result<Self> {
        options.validate()?;
        let views = training_views(dataset)?;
        let mut photos = Pyramid::new(&views, photo_bytes, MIN_PX);
        let position = match scene {
            Some(scene) => start::from_scene(&views, &scene, dataset, options)?,
            None => start::from_points(&views, &dataset.points, &mut photos, options)?,
        };
        Self::assemble(&views, position, identity, photos, backend)
    }

    /// Resumes the run of a checkpoint. `identity` describes the present inputs; with `force` they may
    /// differ, if the photos have the same names. Photos that the run has used are decoded here, once.
    ///
    /// Errors: training photos of other names; without `force`, any other difference; photos that cannot be
    /// decoded.
    pub fn resume(
        dataset: &Dataset,
        checkpoint: Checkpoint,
        identity: RunIdentity,
        force: bool,
        photo_bytes: u64,
        backend: B,
    ) -> Result<Self> {
        let views = training_views(dataset)?;
        let Checkpoint { state, visibility, meta } = checkpoint;
        let before = &meta.identity;
        if !views.iter().map(|v| v.name.as_str()).eq(before.photos.iter().map(|photo| photo.name.as_str())) {
            let value = format!("of {} other photos", before.photos.len());
            return Err(Error::invalid("resume", value, "a checkpoint of this data set with this split"));
        }
        let refused = |difference: &String| {
            let wants = "the photos and options of its run, or `force_resume` to continue with others";
            Error::invalid("resume", format!("of another run: {difference}"), wants)
        };
        let mut differences: Vec<String> = before.difference(&identity).into_iter().collect();
        if let Some(difference) = differences.first().filter(|_| !force) {
            return Err(refused(difference));
        }
        let mut photos = Pyramid::new(&views, photo_bytes, MIN_PX);
        let known = before.photos.iter().enumerate().filter_map(|(i, photo)| Some((i, photo.pixels?)));
        if let Some(i) = photos.first_changed(&known.collect::<Vec<_>>())? {
            let name = &views[i].name;
            differences
                .push(format!("its photo {name} has other pixels (`masks` and `background` count too)"));
        }
        if let Some(difference) = differences.first().filter(|_| !force) {
            return Err(refused(difference));
        }
        let space = meta.space();
        let CheckpointMeta { step, options, dropped, core, exposure, .. } = meta;
        let position = Position { options, space, state, visibility, step, dropped, core, exposure };
        let run = Self::assemble(&views, position, identity, photos, backend)?;
        Ok(Self { differences, ..run })
    }

    fn assemble(
        views: &[&View],
        position: Position,
        identity: RunIdentity,
        photos: Pyramid,
        backend: B,
    ) -> Result<Self> {
        let Position { options, space, state, visibility, step, dropped, core, exposure } = position;
        let (pinned, frozen) = (state.pinned, state.frozen);
        let mut run = Self {
            space,
            cameras: views.iter().map(|v| space.camera_to_training(&v.camera)).collect(),
            identity,
            differences: Vec::new(),
            photos,
            exposure,
            order: Vec::new(),
            backend,
            visibility,
            step,
            dropped,
            figures: Vec::new(),
            pinned,
            frozen,
            core,
            loaded: None,
            level: Schedule::new(&options).level(step),
            full_px: 1.0,
            options,
        };
        run.load(state)?;
        run.plan_epoch();
        Ok(run)
    }

    /// Gives the present state to the backend.
    fn load(&mut self, state: TrainState) -> Result<()> {
        if self.backend.can_be_lost() {
            let visibility = self.visibility.clone();
            self.loaded = Some(LoadedAt { step: self.step, dropped: self.dropped, visibility });
        }
        self.backend.load(state)
    }

    /// Differences from the inputs of this run's checkpoint, one sentence each.
    pub fn differences(&self) -> &[String] {
        &self.differences
    }

    /// Steps made.
    pub fn steps(&self) -> u64 {
        self.step
    }

    /// True when all steps are made.
    pub fn is_done(&self) -> bool {
        self.step >= self.options.steps
    }

    /// The options of the run.
    pub fn options(&self) -> &TrainOptions {
        &self.options
    }

    /// Triangles in the scene.
    pub fn triangles(&self) -> usize {
        self.backend.len()
    }

    /// Gradients dropped because they were not finite, in the steps whose figures are known.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Figures of finished steps, each once, in the order of the steps; with `all`, it waits for unfinished
    /// ones.
    pub fn figures(&mut self, all: bool) -> Result<Vec<StepStats>> {
        self.collect_figures(all)?;
        Ok(std::mem::take(&mut self.figures))
    }

    fn collect_figures(&mut self, all: bool) -> Result<()> {
        let figures = self.backend.figures(all)?;
        self.dropped += figures.iter().map(|stats| stats.dropped).sum::<u64>();
        self.figures.extend(figures);
        Ok(())
    }

    /// Triangles of the shell that closes the scene, behind those that are frozen.
    pub fn shell(&self) -> usize {
        self.pinned - self.frozen
    }

    /// Triangles that are drawn and not trained; they come first.
    pub fn frozen(&self) -> usize {
        self.frozen
    }

    /// Training space.
    pub fn space(&self) -> SceneNormalization {
        self.space
    }

    /// How to draw the present scene: with `options`, and the window, order and alpha cap of the last step.
    pub fn drawing(&self, options: &SoftOptions) -> SoftOptions {
        let last = self.step.max(1) - 1;
        let rates = Schedule::new(&self.options).rates(last);
        let window = Window::Coverage { width_px: 1.0 };
        if self.ends_solid() { SoftOptions { window, ..*options } } else { rates.drawing(options) }
    }

    /// True where [`Trainer::picture`] draws faster than the CPU: soft pictures of the whole scene on a
    /// graphics card.
    pub fn draws(&self, drawing: &SoftOptions) -> bool {
        self.backend.draws() && self.frozen == 0 && solid_samples(drawing).is_none() && !self.ends_solid()
    }

    /// The view of `camera`, in the world, of the present scene.
    ///
    /// Errors: those of the backend; it does not draw.
    pub fn picture(&mut self, camera: &Camera, drawing: &SoftOptions) -> Result<RgbImage> {
        let rates = Schedule::new(&self.options).rates(self.step.max(1) - 1);
        let camera = self.space.camera_to_training(camera);
        Ok(self.backend.picture(&camera, drawing, &rates)?.to_pixels())
    }

    /// Makes one step, and the densification that follows it.
    pub fn step(&mut self) -> Result<StepOutcome> {
        let count = self.cameras.len() as u64;
        if self.step.is_multiple_of(count) {
            self.plan_epoch();
        }
        let index = self.order[(self.step % count) as usize];
        let level = Schedule::new(&self.options).level(self.step);
        let mut pixels = self.photos.take(index, level)?;
        let mut rates = Schedule::new(&self.options).rates(self.step);
        let mut id = None;
        if self.photos.is_cut(index) && pixels.alpha.is_some() {
            // With only one background, triangles of its colour would pass for background.
            let behind = background(self.options.seed, self.step);
            pixels = Arc::new(pixels.over_instead_of_black(behind));
            rates.background = Some(behind.map(|c| f32::from(c) / 255.0));
        } else {
            let corrected;
            (pixels, corrected) = self.exposure.correct(index, pixels);
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
        self.step += 1;
        let densified = match Schedule::new(&self.options).densifies_after(self.step) {
            true => Some(self.densify()?),
            false => None,
        };
        Ok(StepOutcome { densified, width_px: pixels.size.x })
    }

    /// The photos' exposures, as far as they are known.
    pub fn exposure(&self) -> &ExposureEstimates {
        &self.exposure
    }

    /// Estimates the photos' exposures again if this is due, by drawing the present scene with `drawing` for
    /// each.
    pub(super) fn find_exposures(&mut self, drawing: &SoftOptions) -> Result<()> {
        let count = self.cameras.len();
        let cut = (0..count).any(|i| self.photos.is_cut(i));
        if cut || !self.exposure.is_due(self.step, &self.options, count) {
            return Ok(());
        }
        let (drawing, level) = (self.drawing(drawing), self.level);
        let scene = EvalScene::new(&self.soup()?, &self.space, &drawing);
        let (mut soft, mut solid) = (SoftRasterizer::new(), SolidRasterizer::new());
        let mut photos = Vec::with_capacity(count);
        for i in 0..count {
            let photo = self.photos.take(i, level)?;
            let size = compared_size(photo.size);
            let photo = if size == photo.size { photo } else { Arc::new(photo.downscaled(size)) };
            let drawn = scene.draw(&self.cameras[i].resized(size), &drawing, &mut soft, &mut solid);
            photos.push(Cells::new(&photo, &drawn, self.photos.size(i, 0)));
        }
        self.exposure.update(&photos, self.options.exposure);
        Ok(())
    }

    /// Continues with `options` that differ only in the remaining steps and milestones.
    pub(super) fn stretch(&mut self, options: &TrainOptions) {
        (self.options.steps, self.options.milestones) = (options.steps, options.milestones);
    }

    fn densify(&mut self) -> Result<Densified> {
        self.collect_visibility()?;
        let (o, schedule) = (&self.options, Schedule::new(&self.options));
        // Pruning uses the last drawing of the scene.
        let last = self.step - 1;
        let plan = densify::DensifyPlan {
            options: &o.densify,
            max_triangles: usize::try_from(o.max_triangles).unwrap_or(usize::MAX),
            core: self.core,
            grow: schedule.grows_after(self.step),
            prune_weight: schedule.prune_weight(last) as f32,
            prune_opacity: schedule.prune_opacity(last),
            densification: schedule.densification(self.step),
            bisect: schedule.is_engine_shaded(last),
            anneal: schedule.anneal(last),
            seed: o.seed,
            step: self.step,
        };
        let mut state = self.backend.store()?;
        let densified = densify(&mut state, &mut self.visibility, &plan);
        self.load(state)?;
        Ok(densified)
    }

    /// Moves the visibility of the last steps out of the backend.
    fn collect_visibility(&mut self) -> Result<()> {
        let recent = self.backend.take_visibility()?;
        let (uncounted, weightless) = (vec![0; self.visibility.len()], vec![0.0; self.visibility.len()]);
        for (importance, counts) in [(&recent.first, true), (&recent.again, false)] {
            if importance.max_weight.len() == self.visibility.len() {
                let frames = PhotoVisibility {
                    max_weight: &importance.max_weight,
                    sum_weight: if counts { &importance.sum_weight } else { &weightless },
                    views: if counts { &importance.views } else { &uncounted },
                    radius_px: &importance.max_radius_px,
                };
                self.visibility.merge(&frames, self.full_px);
            }
        }
        self.visibility.add_errors(&recent.error);
        Ok(())
    }

    /// Shuffles the photos for the epoch that holds the next step.
    fn plan_epoch(&mut self) {
        let count = self.cameras.len();
        let epoch = self.step / count as u64;
        self.order = order(count, self.options.seed, epoch);
        let level = Schedule::new(&self.options).level(self.step);
        let left = &self.order[(self.step % count as u64) as usize..];
        self.photos.prefetch(left, level);
    }

    /// The present scene, in the data set's world.
    pub fn soup(&mut self) -> Result<Soup> {
        let schedule = Schedule::new(&self.options);
        let last = self.step.max(1) - 1;
        let (anneal, degree) = match self.ends_solid() {
            true => (Anneal::SOLID, 0),
            false => (schedule.anneal(last), schedule.sh_degree(last)),
        };
        let mut soup = self.backend.params()?.to_soup(&anneal, degree);
        self.space.soup_to_world(&mut soup);
        Ok(soup)
    }

    /// True when the run is over and its triangles are opaque from now on.
    fn ends_solid(&self) -> bool {
        self.is_done() && self.options.ends_solid()
    }

    /// Everything needed to resume elsewhere. If the backend has lost the scene, this is the state that it
    /// was last given, after a densification or a checkpoint.
    ///
    /// Errors: the backend has lost the scene, and there is no earlier one.
    pub fn checkpoint(&mut self, curve: &[TrainSample], cpu_secs: f64) -> Result<Checkpoint> {
        let (state, now) = match self.take_state() {
            Ok(state) => {
                // A backend that cannot take the state back fails at the next step; this is the state before
                // that step.
                let _ = self.load(state.clone());
                let visibility = self.visibility.clone();
                (state, LoadedAt { step: self.step, dropped: self.dropped, visibility })
            }
            Err(error) => match (self.backend.rescued(), &self.loaded) {
                (Some(state), Some(loaded)) => (state, loaded.clone()),
                _ => return Err(error),
            },
        };
        let mut identity = self.identity.clone();
        for (i, photo) in identity.photos.iter_mut().enumerate() {
            photo.pixels = self.photos.digest(i);
        }
        let meta = CheckpointMeta {
            generator: trisplat_scene::report::generator(),
            step: now.step,
            options: self.options.clone(),
            space: (self.space.center.to_array(), self.space.scale),
            pinned: self.pinned,
            frozen: self.frozen,
            core: self.core,
            exposure: self.exposure.clone(),
            identity,
            dropped: now.dropped,
            curve: curve.iter().copied().filter(|sample| sample.step <= now.step).collect(),
            cpu_secs,
            pace: None,
        };
        Ok(Checkpoint { state, visibility: now.visibility, meta })
    }

    /// Moves the state and its data out of the backend.
    fn take_state(&mut self) -> Result<TrainState> {
        self.collect_visibility()?;
        self.collect_figures(true)?;
        self.backend.store()
    }
}

/// The background of an object at a step, sRGB-encoded: each channel is 0 or 255. Colours between are nearer to the object's, and so tell
/// less about where it ends: files are up to 0.5 dB worse with them (docs/benchmarks/background.md).
fn background(seed: u64, step: u64) -> [u8; 3] {
    let rng = Rng::new(seed, "background", step);
    [0, 1, 2].map(|channel| if rng.uniform(channel) < 0.5 { 0 } else { 255 })
}

/// The photos to train on.
fn training_views(dataset: &Dataset) -> Result<Vec<&View>> {
    let views: Vec<&View> = dataset.train().collect();
    match views.is_empty() {
        true => Err(Error::invalid("data set", "0 training photos", "one or more; see `test_every`")),
        false => Ok(views),
    }
}
