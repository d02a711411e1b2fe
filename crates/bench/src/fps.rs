//! `trisplat bench fps`: frames per second at the paper's sizes, along real camera paths, checked.
//!
//! Every case draws the same frames: the cameras of the data set, or a circle. Before the clock starts, one
//! frame is read back and compared with the solid rasteriser on the CPU, so that an empty screen cannot win.

use super::frames::{self, Agreement, FrameCost, FrameCount, fitted};
use super::machine::Machine;
use super::three;
use glam::{UVec2, Vec3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_gpu::AdapterOptions;
use trisplat_job::BakedScene;
use trisplat_sample::scenes::{self, SampleScene};
use trisplat_scene::{Asset, Error, ImportedScene, Result, Scene, camera::Camera};
use trisplat_view::{Headless, Model, orbit};

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
          value_parser = trisplat_scene::image::parse_size)]
    pub sizes: Vec<UVec2>,
    /// Frames that are timed.
    #[arg(long, default_value_t = 300, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    pub frames: u32,
    /// Frames that are drawn before the clock starts.
    #[arg(long, default_value_t = 30, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    pub warmup: u32,
    /// Rounds over all cases; the fastest round of each is kept.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    pub rounds: u32,
    /// Samples per pixel at edges (MSAA): 1 or 4.
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=4))]
    pub msaa: u32,
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
    /// Which graphics card draws.
    #[command(flatten, next_help_heading = "Graphics card")]
    pub adapter: AdapterOptions,
    /// How the data set is read.
    #[command(flatten, next_help_heading = "Data set")]
    pub dataset_options: DatasetOptions,
}

/// One case at one size.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FpsRow {
    /// The scene's file, or "studio".
    pub scene: String,
    /// What drew it: "default", or "three.js".
    pub case: String,
    /// Triangles of the scene.
    pub triangles: u64,
    /// Width of the picture, px.
    pub width: u32,
    /// Height of the picture, px.
    pub height: u32,
    /// Samples per pixel at edges.
    pub msaa: u32,
    /// 1000 / median milliseconds per frame.
    pub fps: f64,
    /// What a frame costs.
    #[serde(flatten)]
    pub cost: FrameCost,
    /// Bytes of GPU memory per triangle; null for other renderers.
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
    /// Graphics card, graphics API and driver.
    pub adapter: String,
}

/// A scene and the camera path through it.
struct Flythrough {
    name: String,
    asset: Asset,
    path: Vec<Camera>,
}

/// Measures everything; calls `on_row` with each row as soon as it is there.
pub fn run(args: &FpsArgs, mut on_row: impl FnMut(&FpsRow)) -> Result<Vec<FpsRow>> {
    if ![1, 4].contains(&args.msaa) {
        return Err(Error::invalid("msaa", args.msaa, "1 or 4"));
    }
    let mut card = Headless::new(&args.adapter)?;
    let mut rows = Vec::new();
    let counts: Vec<Option<usize>> =
        if args.file.is_some() { vec![None] } else { args.triangles.iter().copied().map(Some).collect() };
    for triangles in counts {
        let flythrough = flythrough(args, triangles)?;
        let model = card.upload(&flythrough.asset, None)?;
        for &size in &args.sizes {
            let mut measured = measure(args, &mut card, &flythrough, &model, size)?;
            measured.sort_by(|a, b| a.cost.frame_ms.total_cmp(&b.cost.frame_ms));
            measured.iter().for_each(&mut on_row);
            rows.extend(measured);
        }
    }
    if let Some(path) = &args.csv {
        super::machine::append_csv(path, &Machine::here(), &rows)?;
    }
    Ok(rows)
}

/// Reads the file, or makes the sample scene, and plans the camera path.
fn flythrough(args: &FpsArgs, triangles: Option<usize>) -> Result<Flythrough> {
    let (name, loaded) = match (&args.file, triangles) {
        (Some(file), _) => {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            (name, formats::read(file, &ReadOptions::with_degree(0))?)
        }
        (None, count) => {
            let soup = scenes::soup(SampleScene::Studio, count.unwrap_or(100_000), 1);
            let scene = Scene::Soup(soup);
            (
                "studio".into(),
                ImportedScene {
                    scene,
                    provenance: Default::default(),
                    warnings: Vec::new(),
                    cameras: Vec::new(),
                },
            )
        }
    };
    let mut baked = BakedScene::new(loaded)?;
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
    Ok(Flythrough { name, asset: baked.asset, path })
}

/// The model, and with `--three` three.js beside it, at one size, round by round.
fn measure(
    args: &FpsArgs,
    card: &mut Headless,
    flythrough: &Flythrough,
    model: &Model,
    size: UVec2,
) -> Result<Vec<FpsRow>> {
    let path: Vec<Camera> = flythrough.path.iter().map(|camera| fitted(camera, size)).collect();
    let count = FrameCount { warmup: args.warmup as usize, frames: args.frames as usize };
    let checked = path.first().ok_or_else(|| Error::invalid("FILE", "empty", "triangles to draw"))?;
    let frame = frames::picture(card, model, checked)?;
    let agreement = frames::check("default", &frame, &flythrough.asset.mesh, checked)?;
    let bytes = model.bytes as f64 / model.triangles().max(1) as f64;
    let mut rows = vec![("default", Some(bytes), agreement, card.gpu.describe(), None::<FrameCost>)];
    if args.three.is_some() {
        rows.push(("three.js", None, Agreement { psnr: f64::NAN, off: f64::NAN }, String::new(), None));
    }
    for _ in 0..args.rounds {
        for (name, bytes, agreement, adapter, best) in &mut rows {
            let cost = match (*bytes, &args.three) {
                (None, Some(folder)) => {
                    let seen =
                        three::time(folder, &args.chromium, &flythrough.asset, &path, args.msaa, count)?;
                    *agreement = frames::check(name, &seen.picture, &flythrough.asset.mesh, &path[0])?;
                    *adapter = seen.adapter;
                    seen.cost
                }
                _ => frames::time(card, model, &path, args.msaa, count)?,
            };
            if best.is_none_or(|best| cost.frame_ms < best.frame_ms) {
                *best = Some(cost);
            }
        }
    }
    let row = |(name, bytes, agreement, adapter, cost): (&str, _, _, _, Option<FrameCost>)| {
        cost.map(|cost| FpsRow {
            scene: flythrough.name.clone(),
            case: name.to_owned(),
            triangles: flythrough.asset.mesh.face_count() as u64,
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
