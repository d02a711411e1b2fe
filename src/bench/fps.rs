//! `trisplat bench fps`: frames a second at the paper's sizes, along real camera paths, checked.
//!
//! Every case draws the same frames: the cameras of the data set, or a circle. Before the clock counts, one
//! frame is read back and compared with the solid rasteriser on the CPU, so that an empty screen cannot win.

use super::baked::Baked;
use super::frames::{self, Agreement, Cost, Count, fitted};
use super::machine::Machine;
use super::scenes::{self, SampleScene};
use super::three;
use crate::asset::{Asset, Chunk};
use crate::camera::Camera;
use crate::dataset::{Dataset, DatasetOptions};
use crate::error::{Error, Result};
use crate::formats::{self, ReadOptions};
use crate::gpu::AdapterOptions;
use crate::rng::Rng;
use crate::scene::{Loaded, Scene};
use crate::view::headless::Headless;
use crate::view::layout::Layout;
use crate::view::model::{ChunkOrder, Model};
use crate::view::orbit;
use glam::{UVec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// What to measure.
#[derive(Debug, Clone, clap::Args)]
pub struct FpsArgs {
    /// Scene to draw: .glb .gltf .obj .off .ply .pt; a soup is baked in memory.
    #[arg(value_name = "FILE", required_unless_present = "triangles", conflicts_with = "triangles")]
    pub file: Option<PathBuf>,
    /// Draw the sample scene with these numbers of triangles instead of a file.
    #[arg(long, value_delimiter = ',', value_name = "N,N,…")]
    pub triangles: Vec<usize>,
    /// Data set whose cameras are the path; without it a circle around the scene.
    #[arg(long, value_name = "DATASET", requires = "file")]
    pub dataset: Option<PathBuf>,
    /// Sizes of the picture, px: by default the paper's.
    #[arg(long, value_delimiter = ',', default_value = "1280x720,1920x1080,3840x2160", value_name = "WxH,…",
          value_parser = size)]
    pub sizes: Vec<UVec2>,
    /// Frames that are timed.
    #[arg(long, default_value_t = 300, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: u32,
    /// Frames that are drawn before the clock starts.
    #[arg(long, default_value_t = 30, value_name = "N")]
    pub warmup: u32,
    /// Times that all cases take turns; the fastest turn of each is kept.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub turns: u32,
    /// Samples of edges: 1 or 4 a pixel.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4))]
    pub msaa: u32,
    /// Also draw in every other way: other layouts of corners, other orders, without chunks.
    #[arg(long)]
    pub against: bool,
    /// Also draw with three.js in headless Chromium: a folder whose node_modules holds three and playwright-core.
    #[arg(long, value_name = "FOLDER")]
    pub three: Option<PathBuf>,
    /// Chromium for --three.
    #[arg(long, default_value = "/usr/bin/chromium", value_name = "PROGRAM")]
    pub chromium: PathBuf,
    /// Print rows as JSON.
    #[arg(long)]
    pub json: bool,
    /// Append rows to this CSV file.
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Draw milliseconds a frame against triangles as SVG.
    #[arg(long, value_name = "FILE")]
    pub plot: Option<PathBuf>,
    /// Which graphics card draws.
    #[command(flatten, next_help_heading = "Graphics card")]
    pub adapter: AdapterOptions,
    /// How the data set is read.
    #[command(flatten, next_help_heading = "Data set")]
    pub dataset_options: DatasetOptions,
}

/// 1280x720 as a size.
pub fn size(text: &str) -> std::result::Result<UVec2, String> {
    let sides = text.split_once(['x', 'X']);
    let parsed = sides.and_then(|(w, h)| Some(UVec2::new(w.parse().ok()?, h.parse().ok()?)));
    parsed.filter(|s| s.min_element() > 0).ok_or_else(|| "wants WIDTHxHEIGHT, such as 1280x720".into())
}

/// One case at one size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FpsRow {
    /// The scene's file, or "studio".
    pub scene: String,
    /// How it was drawn: "default", or what differs from it.
    pub case: String,
    /// Triangles of the scene.
    pub triangles: u64,
    /// Width of the picture, px.
    pub width: u32,
    /// Height of the picture, px.
    pub height: u32,
    /// Samples of edges a pixel.
    pub msaa: u32,
    /// 1000 / median milliseconds a frame.
    pub fps: f64,
    /// What a frame costs.
    #[serde(flatten)]
    pub cost: Cost,
    /// Bytes in the card's memory a triangle; null where they are not ours.
    pub bytes_per_triangle: Option<f64>,
    /// Frames timed.
    pub frames: u32,
    /// Frames before.
    pub warmup: u32,
    /// Cameras of the path.
    pub cameras: u64,
    /// How close a frame comes to the CPU's.
    #[serde(flatten)]
    pub agreement: Agreement,
    /// Card, interface and driver.
    pub adapter: String,
}

/// A scene and the path through it.
struct Course {
    name: String,
    asset: Asset,
    path: Vec<Camera>,
}

/// A way to draw.
struct Case {
    name: &'static str,
    model: Model,
    order: ChunkOrder,
}

/// Measures everything; rows come as they are known.
pub fn run(args: &FpsArgs, mut tell: impl FnMut(&FpsRow)) -> Result<Vec<FpsRow>> {
    if ![1, 4].contains(&args.msaa) {
        return Err(Error::invalid("--msaa", args.msaa, "1 or 4"));
    }
    let mut card = Headless::new(&args.adapter)?;
    let mut rows = Vec::new();
    let counts: Vec<Option<usize>> =
        if args.file.is_some() { vec![None] } else { args.triangles.iter().copied().map(Some).collect() };
    for triangles in counts {
        let course = course(args, triangles)?;
        let cases = cases(&card, &course.asset, args.against)?;
        for &size in &args.sizes {
            let mut measured = measure(args, &mut card, &course, &cases, size)?;
            measured.sort_by(|a, b| a.cost.frame_ms.total_cmp(&b.cost.frame_ms));
            measured.iter().for_each(&mut tell);
            rows.extend(measured);
        }
    }
    if let Some(path) = &args.csv {
        super::machine::append_csv(path, &Machine::here(), &rows)?;
    }
    if let Some(path) = &args.plot {
        super::plot::frames(path, &rows)?;
    }
    Ok(rows)
}

/// Reads the file, or makes the sample scene, and lays the path.
fn course(args: &FpsArgs, triangles: Option<usize>) -> Result<Course> {
    let (name, loaded) = match (&args.file, triangles) {
        (Some(file), _) => {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            (name, formats::read(file, &ReadOptions { sh_degree: 0 })?)
        }
        (None, count) => {
            let soup = scenes::soup(SampleScene::Studio, count.unwrap_or(100_000), 1);
            let scene = Scene::Soup(soup);
            (
                "studio".into(),
                Loaded { scene, provenance: Default::default(), warnings: Vec::new(), cameras: Vec::new() },
            )
        }
    };
    let mut baked = Baked::new(loaded)?;
    let path = match &args.dataset {
        Some(path) => {
            let dataset = Dataset::load(path, &args.dataset_options)?;
            dataset.views.iter().map(|view| baked.place(&view.camera, dataset.origin)).collect()
        }
        None => {
            let scene = Scene::Mesh(std::mem::take(&mut baked.asset.mesh));
            let path = orbit::around_scene(&scene, Vec3::Y, 1280, 36);
            if let Scene::Mesh(mesh) = scene {
                baked.asset.mesh = mesh;
            }
            path
        }
    };
    Ok(Course { name, asset: baked.asset, path })
}

/// The default, and what it is held against.
fn cases(card: &Headless, asset: &Asset, against: bool) -> Result<Vec<Case>> {
    let case =
        |name, asset: &Asset, layout, order| Ok(Case { name, model: card.upload(asset, layout)?, order });
    let mut cases = vec![case("default", asset, None, ChunkOrder::File)?];
    if !against {
        return Ok(cases);
    }
    cases.push(case("near chunks first", asset, None, ChunkOrder::Near)?);
    for (name, layout) in
        [("corner layout", Layout::Corner), ("face layout", Layout::Face), ("grid layout", Layout::Grid)]
    {
        if layout.fits(&asset.mesh) && layout != cases[0].model.layout {
            cases.push(case(name, asset, Some(layout), ChunkOrder::File)?);
        }
    }
    let count = asset.mesh.face_count() as u32;
    let chunks = vec![Chunk { first: 0, count }];
    let mut whole = Asset { mesh: asset.mesh.clone(), chunks, ..Asset::default() };
    cases.push(case("one chunk", &whole, None, ChunkOrder::File)?);
    let mut order: Vec<u32> = (0..count).collect();
    let rng = Rng::new(1, "shuffled faces", 0);
    order.sort_by_cached_key(|&face| rng.uniform_f64(face.into()).to_bits());
    whole.mesh.select(&order);
    cases.push(case("one chunk, shuffled", &whole, None, ChunkOrder::File)?);
    Ok(cases)
}

/// All cases at one size, taking turns.
fn measure(
    args: &FpsArgs,
    card: &mut Headless,
    course: &Course,
    cases: &[Case],
    size: UVec2,
) -> Result<Vec<FpsRow>> {
    let path: Vec<Camera> = course.path.iter().map(|camera| fitted(camera, size)).collect();
    let count = Count { warmup: args.warmup as usize, frames: args.frames as usize };
    let mut rows = Vec::new();
    for case in cases {
        let checked = path.first().ok_or_else(|| Error::invalid("FILE", "empty", "triangles to draw"))?;
        let frame = frames::picture(card, &case.model, checked, case.order)?;
        let agreement = frames::check(case.name, &frame, &course.asset.mesh, checked)?;
        let bytes = case.model.bytes as f64 / case.model.triangles().max(1) as f64;
        rows.push((case.name, Some(bytes), agreement, card.gpu.describe(), None::<Cost>));
    }
    if args.three.is_some() {
        rows.push(("three.js", None, Agreement { psnr: f64::NAN, off: f64::NAN }, String::new(), None));
    }
    for _ in 0..args.turns {
        for (i, (name, _, agreement, adapter, best)) in rows.iter_mut().enumerate() {
            let cost = match (cases.get(i), &args.three) {
                (Some(case), _) => frames::time(card, &case.model, &path, case.order, args.msaa, count)?,
                (None, Some(folder)) => {
                    let seen = three::time(folder, &args.chromium, &course.asset, &path, args.msaa, count)?;
                    *agreement = frames::check(name, &seen.picture, &course.asset.mesh, &path[0])?;
                    *adapter = seen.adapter;
                    seen.cost
                }
                (None, None) => continue,
            };
            if best.is_none_or(|best| cost.frame_ms < best.frame_ms) {
                *best = Some(cost);
            }
        }
    }
    let row = |(name, bytes, agreement, adapter, cost): (&str, _, _, _, Option<Cost>)| {
        cost.map(|cost| FpsRow {
            scene: course.name.clone(),
            case: name.to_owned(),
            triangles: course.asset.mesh.face_count() as u64,
            width: size.x,
            height: size.y,
            msaa: args.msaa,
            fps: 1e3 / cost.frame_ms,
            cost,
            bytes_per_triangle: bytes,
            frames: args.frames,
            warmup: args.warmup,
            cameras: path.len() as u64,
            agreement,
            adapter,
        })
    };
    Ok(rows.into_iter().filter_map(row).collect())
}
