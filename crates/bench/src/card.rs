//! `trisplat bench card`: steps per second of the training on a graphics card, and where their time goes, against what the card's
//! memory can do.
//!
//! Without a file the scene is the sample one, whose triangles are as large, faint and soft as those of a trained scene, seen from a
//! circle around it; photos are patterns, as no stage depends on what they show.

use super::frames::fitted;
use glam::{UVec2, Vec3};
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use std::time::Instant;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_gpu::{AdapterOptions, Gpu, copy_bandwidth};
use trisplat_raster::soft::SoftOptions;
use trisplat_sample::scenes::{self, SampleScene};
use trisplat_scene::{
    Error, Result, Scene, SceneNormalization, Soup, camera::Camera, image::RgbImage, placed,
    process::cpu_secs,
};
use trisplat_train::{
    CpuBackend, GpuBackend, Params, PhotoId, Schedule, StepParams, StepPhoto, StepTimes, TrainBackend,
    TrainOptions, TrainPreset, TrainState,
};
use trisplat_view::orbit;

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct CardArgs {
    /// Soup to train on: .ply .pt; without it the sample scene.
    #[arg(value_name = "FILE", requires = "dataset", conflicts_with_all = ["triangles", "sizes"])]
    pub file: Option<PathBuf>,
    /// Data set whose photos the steps are made on.
    #[arg(long, value_name = "DATASET", requires = "file")]
    pub dataset: Option<PathBuf>,
    /// Triangles of the sample scene.
    #[arg(long, value_delimiter = ',', default_value = "200000", value_name = "N,N,…", value_parser = trisplat_scene::ranges::count)]
    pub triangles: Vec<usize>,
    /// Sizes of its photos, px.
    #[arg(long, value_delimiter = ',', default_value = "1280x853", value_name = "WxH,…", value_parser = trisplat_scene::image::parse_size)]
    pub sizes: Vec<UVec2>,
    /// Kinds of steps: soft ones halfway through a run, or the last of a solid run, with engine shading.
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        default_value = "soft-outdoor,solid",
        value_name = "NAME,…"
    )]
    pub presets: Vec<TrainPreset>,
    /// Degree of the view-dependent colour.
    #[arg(long, default_value_t = 3, value_name = "N", value_parser = clap::value_parser!(u8).range(0..=3))]
    pub sh_degree: u8,
    /// Steps that are timed.
    #[arg(long, default_value_t = 100, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub steps: u32,
    /// Steps before the clock starts.
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    pub warmup: u32,
    /// Steps on the CPU, for comparison; 0: none.
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    pub cpu_steps: u32,
    /// Print rows as JSON.
    #[arg(long)]
    pub json: bool,
    /// Which graphics card.
    #[command(flatten, next_help_heading = "Graphics card")]
    pub adapter: AdapterOptions,
    /// How the data set is read.
    #[command(flatten, next_help_heading = "Data set")]
    pub dataset_options: DatasetOptions,
}

/// Steps of one scene.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CardRow {
    /// Kind of the steps.
    pub preset: TrainPreset,
    /// Triangles of the scene.
    pub triangles: u64,
    /// Width and height of the largest photo, px.
    pub size: [u32; 2],
    /// Triangles in view of the step that was timed in stages, those through the near plane twice; 0 without timestamps.
    pub splats: u64,
    /// Its pairs of triangles and tiles.
    pub pairs: u64,
    /// Steps per second.
    pub steps_per_second: f64,
    /// CPU milliseconds per step, all threads: with a software renderer this is the step itself.
    pub cpu_ms: f64,
    /// CPU milliseconds of a step on the CPU; null if none was made.
    pub cpu_backend_ms: Option<f64>,
    /// Where the time of a step goes; empty where the card has no timestamps.
    pub stages: Vec<StageRow>,
    /// Bytes per second that the card reads and writes together while it copies.
    pub copy_bandwidth: f64,
    /// Card, graphics API and driver.
    pub adapter: String,
}

/// A stage of a step.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct StageRow {
    /// Its name.
    pub name: String,
    /// Milliseconds, mean over some steps.
    pub ms: f64,
    /// Bytes that it reads and writes, each buffer once for each pass over it.
    pub bytes: u64,
    /// Share of the bandwidth of a copy, of 1.
    pub share: f64,
}

/// A scene, and photos of it.
struct Workload {
    state: TrainState,
    photos: Vec<(Camera, RgbImage)>,
}

/// Photos of the sample scene.
const PHOTOS: u32 = 8;
/// Steps that are timed in stages.
const TIMED: usize = 8;

/// Measures everything; calls `on_row` with each row as soon as it is there.
///
/// Errors: no card as asked for, one that cannot train so much; files that cannot be read.
pub fn run(args: &CardArgs, mut on_row: impl FnMut(&CardRow)) -> Result<Vec<CardRow>> {
    let gpu = Gpu::headless(&args.adapter)?;
    let copy_bandwidth = copy_bandwidth(&gpu)?;
    let mut card = GpuBackend::new(gpu, SoftOptions::default())?;
    let mut rows = Vec::new();
    for workload in workloads(args) {
        let workload = workload?;
        for &preset in &args.presets {
            let row = card_row(args, preset, &mut card, &workload, copy_bandwidth)?;
            on_row(&row);
            rows.push(row);
        }
    }
    Ok(rows)
}

/// The options of a run, and the rates of the steps that are timed: with all coefficients in use and photos of full size.
fn steps_of(preset: TrainPreset, sh_degree: u8) -> (SoftOptions, StepParams) {
    let options = TrainOptions { sh_degree, ..TrainOptions::preset(preset) };
    let last = options.steps.saturating_sub(1);
    let step = if options.ends_solid() { last } else { options.steps / 2 };
    (options.drawing([0.0; 3]), Schedule::new(&options).rates(step))
}

/// The scenes, made one after the other.
fn workloads(args: &CardArgs) -> Box<dyn Iterator<Item = Result<Workload>> + '_> {
    match &args.file {
        Some(_) => Box::new(std::iter::once_with(|| from_file(args))),
        None => Box::new(args.triangles.iter().flat_map(move |&triangles| {
            args.sizes.iter().map(move |&size| sample(triangles, size, args.sh_degree))
        })),
    }
}

fn sample(triangles: usize, size: UVec2, sh_degree: u8) -> Result<Workload> {
    let scene = Scene::Soup(scenes::soup(SampleScene::Studio, triangles, 1));
    let cameras = orbit::around_scene(&scene, Vec3::NEG_Y, size.x, PHOTOS);
    let Scene::Soup(soup) = scene else { return Err(Error::invalid("triangles", triangles, "a soup")) };
    let photo = |camera: &Camera| (fitted(camera, size), pattern(size));
    Workload::new(soup, cameras.iter().map(photo).collect(), sh_degree)
}

fn from_file(args: &CardArgs) -> Result<Workload> {
    let (Some(file), Some(folder)) = (&args.file, &args.dataset) else {
        return Err(Error::invalid("dataset", "missing", "the photos of FILE"));
    };
    let loaded = formats::read(file, &ReadOptions::with_degree(args.sh_degree))?;
    let Scene::Soup(soup) = loaded.scene else {
        return Err(Error::unsupported(
            file,
            "is a mesh; give the trained soup it was baked from (.ply or .pt)",
        ));
    };
    let dataset = Dataset::load(folder, &args.dataset_options)?;
    let placement = &loaded.provenance.placement;
    let photo = |view: &trisplat_dataset::View| {
        let pixels = view.photo.decode()?;
        let camera = view.camera.resized(pixels.size);
        Ok((placed::to_file(&camera, placement, dataset.origin), pixels))
    };
    let photos = dataset.train().map(photo).collect::<Result<_>>()?;
    Workload::new(soup, photos, args.sh_degree)
}

impl Workload {
    /// In training space.
    fn new(mut soup: Soup, photos: Vec<(Camera, RgbImage)>, sh_degree: u8) -> Result<Self> {
        if soup.is_empty() || photos.is_empty() {
            return Err(Error::invalid("FILE", "empty", "triangles to train, and photos"));
        }
        let cameras: Vec<Camera> = photos.iter().map(|(camera, _)| *camera).collect();
        let space = SceneNormalization::new(&cameras, &[]);
        space.soup_to_training(&mut soup);
        let photos = photos.into_iter().map(|(camera, pixels)| (space.camera_to_training(&camera), pixels));
        Ok(Self { photos: photos.collect(), state: TrainState::new(Params::from_soup(&soup, sh_degree)) })
    }

    fn photo(&self, step: usize) -> StepPhoto<'_> {
        let index = step % self.photos.len();
        let (camera, pixels) = &self.photos[index];
        let id = Some(PhotoId { corrected: 0, index, level: 0 });
        StepPhoto { camera, pixels, first: step < self.photos.len(), id }
    }
}

/// A picture without meaning.
fn pattern(size: UVec2) -> RgbImage {
    let color = |i: u32| [3 * (i % size.x), 2 * (i / size.x), i].map(|c| (c % 256) as u8);
    RgbImage { size, rgb: (0..size.element_product()).map(color).collect(), alpha: None }
}

/// What a step costs.
struct StepCost {
    wall_ms: f64,
    cpu_ms: f64,
}

fn cost(
    backend: &mut dyn TrainBackend,
    work: &Workload,
    rates: &StepParams,
    warmup: u32,
    steps: u32,
) -> Result<StepCost> {
    for step in 0..warmup {
        backend.step(&work.photo(step as usize), rates)?;
    }
    backend.figures(true)?;
    let (cpu, clock) = (cpu_secs(), Instant::now());
    for step in 0..steps {
        backend.step(&work.photo((warmup + step) as usize), rates)?;
    }
    backend.figures(true)?;
    let each = |seconds: f64| 1e3 * seconds / f64::from(steps);
    Ok(StepCost { wall_ms: each(clock.elapsed().as_secs_f64()), cpu_ms: each(cpu_secs() - cpu) })
}

fn card_row(
    args: &CardArgs,
    preset: TrainPreset,
    card: &mut GpuBackend,
    work: &Workload,
    copy_bandwidth: f64,
) -> Result<CardRow> {
    let (drawing, rates) = steps_of(preset, args.sh_degree);
    let (rates, limits) = (&rates, card.limits());
    card.restart(drawing, limits);
    card.load(work.state.clone())?;
    let StepCost { wall_ms, cpu_ms } = cost(card, work, rates, args.warmup, args.steps)?;
    let mut times = Vec::new();
    for step in 0..TIMED {
        times.extend(card.timed_step(&work.photo(step), rates)?);
    }
    let last = times.last().map(|times| times.work);
    let size = work.photos.iter().map(|(camera, _)| camera.size).max_by_key(|size| size.element_product());
    Ok(CardRow {
        preset,
        triangles: work.state.params.len() as u64,
        size: size.unwrap_or_default().to_array(),
        splats: last.map_or(0, |work| work.splats),
        pairs: last.map_or(0, |work| work.pairs),
        steps_per_second: 1e3 / wall_ms,
        cpu_ms,
        cpu_backend_ms: cpu_cost(args, drawing, work, rates)?,
        stages: stages(&times, copy_bandwidth),
        copy_bandwidth,
        adapter: card.gpu().describe(),
    })
}

/// CPU milliseconds of a step on the CPU, if it is asked for.
fn cpu_cost(
    args: &CardArgs,
    drawing: SoftOptions,
    work: &Workload,
    rates: &StepParams,
) -> Result<Option<f64>> {
    if args.cpu_steps == 0 {
        return Ok(None);
    }
    let mut cpu = CpuBackend::new(drawing);
    cpu.load(work.state.clone())?;
    Ok(Some(cost(&mut cpu, work, rates, 1, args.cpu_steps)?.cpu_ms))
}

/// Means over steps that were timed.
fn stages(times: &[StepTimes], copy_bandwidth: f64) -> Vec<StageRow> {
    let Some(first) = times.first() else { return Vec::new() };
    let n = times.len() as f64;
    let stage = |(at, (name, _)): (usize, &(&'static str, f64))| {
        let ms = times.iter().map(|times| times.stages[at].1).sum::<f64>() / n;
        let bytes = times.iter().map(|times| times.work.bytes(name).unwrap_or(0)).sum::<u64>() as f64 / n;
        let share = if ms > 0.0 { bytes / (1e-3 * ms) / copy_bandwidth } else { 0.0 };
        StageRow { name: (*name).to_owned(), ms, bytes: bytes as u64, share }
    };
    first.stages.iter().enumerate().map(stage).collect()
}
