//! One run: photos in a random order, one step per photo, refinements between them.

use super::backend::{StepPhoto, StepStats, TrainBackend};
use super::checkpoint::{Checkpoint, CheckpointMeta};
use super::from_scene;
use super::init::{InitPoint, first_soup};
use super::options::TrainOptions;
use super::params::{Anneal, Params, TrainState};
use super::progress::TrainSample;
use super::pyramid::{Pyramid, order};
use super::refine::{self, Refined, refine};
use super::schedule::Schedule;
use super::visibility::{PhotoVisibility, VisibilityStats};
use crate::asset::Placement;
use crate::camera::Camera;
use crate::dataset::{Dataset, DatasetKind, Point, View, cloud};
use crate::error::{Error, Result};
use crate::raster::soft::{SoftOptions, Window};
use crate::scene::Loaded;
use crate::soup::Soup;
use crate::space::Space;
use glam::Vec3;

/// A run between two steps. A pure function of the data set, the options and the steps made: stopping,
/// writing a checkpoint and resuming elsewhere changes no bit.
#[derive(Debug)]
pub struct Trainer<B> {
    options: TrainOptions,
    space: Space,
    cameras: Vec<Camera>,
    names: Vec<String>,
    photos: Pyramid,
    order: Vec<usize>,
    backend: B,
    visibility: VisibilityStats,
    step: u64,
    dropped: u64,
    level: u32,
    /// Pixels of the full photo per pixel of those drawn at this level.
    full_px: f32,
    /// The photo of the step, sRGB-encoded. `[H * W]`
    rgb: Vec<[f32; 3]>,
    /// How much each of its pixels counts; empty when all do. `[H * W]`
    weight: Vec<f32>,
}

/// What [`Trainer::step`] did.
#[derive(Debug, Clone, Copy)]
pub struct StepOutcome {
    /// Figures of the step.
    pub stats: StepStats,
    /// The refinement after the step, if one was due.
    pub refined: Option<Refined>,
    /// Width of the photo, px.
    pub width_px: u32,
}

/// Where a run stands between two steps.
struct Position {
    options: TrainOptions,
    space: Space,
    state: TrainState,
    visibility: VisibilityStats,
    step: u64,
    dropped: u64,
}

impl<B: TrainBackend> Trainer<B> {
    /// A run from its beginning: from the triangles of `scene`, or from the points of the data set.
    /// `photo_bytes` is the memory for decoded photos.
    ///
    /// Errors: options out of range, no training photos, a scene of more triangles than the options permit.
    pub fn start(
        dataset: &Dataset,
        scene: Option<&Loaded>,
        options: &TrainOptions,
        photo_bytes: u64,
        backend: B,
    ) -> Result<Self> {
        options.validate()?;
        let views: Vec<&View> = dataset.train().collect();
        let position = match scene {
            Some(scene) => scene_position(&views, scene, dataset, options)?,
            None => first_position(&views, &dataset.points, options),
        };
        Self::assemble(&views, position, photo_bytes, backend)
    }

    /// The run a checkpoint was made of.
    ///
    /// Errors: the data set's training photos are not the same.
    pub fn resume(dataset: &Dataset, checkpoint: Checkpoint, photo_bytes: u64, backend: B) -> Result<Self> {
        let views: Vec<&View> = dataset.train().collect();
        let Checkpoint { state, visibility, meta } = checkpoint;
        if !views.iter().map(|v| v.name.as_str()).eq(meta.photos.iter().map(String::as_str)) {
            let value = format!("of {} other photos", meta.photos.len());
            return Err(Error::invalid("resume", value, "a checkpoint of this data set with this split"));
        }
        let space = meta.space();
        let CheckpointMeta { step, options, dropped, .. } = meta;
        let position = Position { options, space, state, visibility, step, dropped };
        Self::assemble(&views, position, photo_bytes, backend)
    }

    fn assemble(views: &[&View], position: Position, photo_bytes: u64, mut backend: B) -> Result<Self> {
        if views.is_empty() {
            return Err(Error::invalid("data set", "0 training photos", "one or more; see `test_every`"));
        }
        let Position { options, space, state, visibility, step, dropped } = position;
        backend.load(state)?;
        let mut run = Self {
            space,
            cameras: views.iter().map(|v| space.camera_to_training(&v.camera)).collect(),
            names: views.iter().map(|v| v.name.clone()).collect(),
            photos: Pyramid::new(views, photo_bytes, options.warmup.min_px),
            order: Vec::new(),
            backend,
            visibility,
            step,
            dropped,
            level: Schedule::new(&options).level(step),
            full_px: 1.0,
            rgb: Vec::new(),
            weight: Vec::new(),
            options,
        };
        run.plan_epoch();
        Ok(run)
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

    /// Gradients dropped so far because they were not finite.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Training space.
    pub fn space(&self) -> Space {
        self.space
    }

    /// How to draw the scene as it is: as `options`, with the window, order and alpha cap of the last step.
    pub fn drawing(&self, options: &SoftOptions) -> SoftOptions {
        let last = self.step.max(1) - 1;
        let rates = Schedule::new(&self.options).rates(last);
        let window = Window::Coverage { width_px: 1.0 };
        if self.ends_solid() { SoftOptions { window, ..*options } } else { rates.drawing(options) }
    }

    /// Makes one step, and the refinement that follows it.
    pub fn step(&mut self) -> Result<StepOutcome> {
        let count = self.cameras.len() as u64;
        if self.step.is_multiple_of(count) {
            self.plan_epoch();
        }
        let index = self.order[(self.step % count) as usize];
        let level = Schedule::new(&self.options).level(self.step);
        let pixels = self.photos.take(index, level)?;
        self.rgb.clear();
        self.rgb.extend(pixels.rgb.iter().map(|p| p.map(|c| f32::from(c) * (1.0 / 255.0))));
        self.weight.clear();
        self.weight.extend(pixels.alpha.iter().flatten().map(|&a| f32::from(a) * (1.0 / 255.0)));

        let camera = self.cameras[index].resized(pixels.size);
        if level != self.level {
            // The visibility so far is that at another size.
            self.collect_visibility()?;
            self.level = level;
        }
        self.full_px = self.photos.size(index, 0).x as f32 / pixels.size.x as f32;
        let photo = StepPhoto {
            camera: &camera,
            rgb: &self.rgb,
            weight: pixels.alpha.is_some().then_some(&self.weight),
            first: self.visibility.record_photo(index),
        };
        let rates = Schedule::new(&self.options).rates(self.step);
        let stats = self.backend.step(&photo, &rates)?;
        self.step += 1;
        self.dropped += stats.dropped;
        let refined = match Schedule::new(&self.options).refines_after(self.step) {
            true => Some(self.refine()?),
            false => None,
        };
        Ok(StepOutcome { stats, refined, width_px: pixels.size.x })
    }

    fn refine(&mut self) -> Result<Refined> {
        self.collect_visibility()?;
        let (o, schedule) = (&self.options, Schedule::new(&self.options));
        // The scene is pruned as it was drawn last.
        let last = self.step - 1;
        let plan = refine::RefinePlan {
            options: &o.refine,
            max_triangles: usize::try_from(o.max_triangles).unwrap_or(usize::MAX),
            grow: schedule.grows_after(self.step),
            prune_weight: schedule.prune_weight(last) as f32,
            prune_opacity: schedule.prune_opacity(last),
            prune_sigma: schedule.prune_sigma(last),
            refinement: schedule.refinement(self.step),
            bisect: schedule.is_engine_shaded(last),
            anneal: schedule.anneal(last),
            seed: o.seed,
            step: self.step,
        };
        let mut state = self.backend.store()?;
        let refined = refine(&mut state, &mut self.visibility, &plan);
        self.backend.load(state)?;
        Ok(refined)
    }

    /// Moves the visibility of the last steps out of the backend.
    fn collect_visibility(&mut self) -> Result<()> {
        let recent = self.backend.take_visibility()?;
        let zeros = vec![0; self.visibility.len()];
        for (importance, counts) in [(&recent.first, true), (&recent.again, false)] {
            if importance.max_weight.len() == self.visibility.len() {
                let frames = PhotoVisibility {
                    max_weight: &importance.max_weight,
                    views: if counts { &importance.views } else { &zeros },
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

    /// The scene as it is, in the data set's world.
    pub fn soup(&mut self) -> Result<Soup> {
        let schedule = Schedule::new(&self.options);
        let last = self.step.max(1) - 1;
        let state = self.backend.store()?;
        let (anneal, degree) = match self.ends_solid() {
            true => (Anneal::SOLID, 0),
            false => (schedule.anneal(last), schedule.sh_degree(last)),
        };
        let mut soup = state.params.to_soup(&anneal, degree);
        self.backend.load(state)?;
        self.space.soup_to_world(&mut soup);
        Ok(soup)
    }

    /// True when the run is over and its triangles are opaque from now on.
    fn ends_solid(&self) -> bool {
        self.is_done() && self.options.solid.enabled
    }

    /// Everything needed to resume elsewhere.
    pub fn checkpoint(&mut self, curve: &[TrainSample], cpu_secs: f64) -> Result<Checkpoint> {
        self.collect_visibility()?;
        let state = self.backend.store()?;
        self.backend.load(state.clone())?;
        let meta = CheckpointMeta {
            generator: crate::report::generator(),
            step: self.step,
            options: self.options.clone(),
            space: (self.space.center.to_array(), self.space.scale),
            photos: self.names.clone(),
            dropped: self.dropped,
            curve: curve.to_vec(),
            cpu_secs,
        };
        Ok(Checkpoint { state, visibility: self.visibility.clone(), meta })
    }
}

/// The first triangles, one per point of the sparse cloud or of a random one.
fn first_position(views: &[&View], points: &[Point], options: &TrainOptions) -> Position {
    let random;
    let points = if points.is_empty() {
        random = cloud::random(views, options.init.random_points as usize, options.seed);
        &random
    } else {
        points
    };
    let cameras: Vec<Camera> = views.iter().map(|v| v.camera).collect();
    let positions: Vec<Vec3> = points.iter().map(|p| p.position).collect();
    let space = Space::new(&cameras, &positions);
    let init_points: Vec<InitPoint> = points
        .iter()
        .map(|p| InitPoint {
            position: space.to_training(p.position),
            rgb: p.rgb.map(|c| f32::from(c) / 255.0),
        })
        .collect();
    let mut soup = first_soup(&init_points, &options.init, options.seed);
    let most = usize::try_from(options.max_triangles).unwrap_or(usize::MAX);
    let count = soup.len();
    if count > most {
        // Evenly over the cloud, which files store in no order that matters.
        soup.retain(|i| (i + 1) * most / count > i * most / count);
    }
    at_first_step(views, options, space, &soup)
}

/// The triangles of a scene that is there already.
fn scene_position(
    views: &[&View],
    scene: &Loaded,
    dataset: &Dataset,
    options: &TrainOptions,
) -> Result<Position> {
    let cameras: Vec<Camera> = views.iter().map(|v| v.camera).collect();
    // Pictures drawn of the scene are in the frame of its file.
    let placement = match dataset.kind {
        DatasetKind::Drawn => Placement::IDENTITY,
        _ => scene.provenance.placement,
    };
    let positions: Vec<Vec3> = match dataset.points.is_empty() {
        true => from_scene::centers(scene, &placement, dataset.origin),
        false => dataset.points.iter().map(|p| p.position).collect(),
    };
    let space = Space::new(&cameras, &positions);
    let soup = from_scene::first_soup(scene, &placement, dataset.origin, &space, options.max_triangles)?;
    Ok(at_first_step(views, options, space, &soup))
}

fn at_first_step(views: &[&View], options: &TrainOptions, space: Space, soup: &Soup) -> Position {
    Position {
        options: options.clone(),
        space,
        visibility: VisibilityStats::new(soup.len(), views.len()),
        state: TrainState::new(Params::from_soup(soup, options.sh_degree)),
        step: 0,
        dropped: 0,
    }
}
