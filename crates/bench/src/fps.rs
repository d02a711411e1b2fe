//! `fps`: frames per second at the paper's sizes, along real camera paths, checked.
//!
//! Every case draws the same frames: the cameras of the data set, or a circle. Before the clock
//! starts, one frame is read back and compared with the solid rasteriser on the CPU, so that an
//! empty screen cannot win.

use super::machine::print_json;
use glam::{UVec2, Vec3};
use serde::Serialize;
use std::path::PathBuf;
use std::time::Instant;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_formats::{self as formats, ReadOptions};
use trisplat_gpu::AdapterOptions;
use trisplat_job::BakedScene;
use trisplat_raster::framing::orbit;
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::metric;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::{Asset, Error, ImportedScene, Result, Scene, process};
use trisplat_view::{Canvas, DrawStats, FrameParams, Headless, Model};

/// Background colour: one that no scene is likely to have, so that holes are seen.
const BACKGROUND: [f32; 3] = [1.0, 0.0, 1.0];
const NEAR: f32 = 0.01;
/// Minimum agreement of a frame with the solid rasteriser on the CPU that counts as the same
/// picture, dB.
const MIN_PSNR: f64 = 30.0;

/// Measurement of frames per second.
#[derive(Debug, Clone, clap::Args)]
pub(crate) struct FpsArgs {
    /// Scene to draw: .glb .gltf .obj .off .ply .pt; a soup is baked in memory.
    #[arg(
        value_name = "FILE",
        required_unless_present = "triangles",
        conflicts_with = "triangles"
    )]
    file: Option<PathBuf>,
    /// Draw the sample scene with these numbers of triangles instead of a file.
    #[arg(long, value_delimiter = ',', value_name = "N,N,…", value_parser = trisplat_scene::ranges::count)]
    triangles: Vec<usize>,
    /// Data set whose cameras are the path; without it a circle around the scene.
    #[arg(long, value_name = "DATASET", requires = "file")]
    dataset: Option<PathBuf>,
    /// Sizes of the picture, px: by default the paper's.
    #[arg(long, value_delimiter = ',', default_value = "1280x720,1920x1080,3840x2160", value_name = "WxH,…",
          value_parser = trisplat_scene::image::parse_size)]
    sizes: Vec<UVec2>,
    /// Frames that are timed.
    #[arg(long, default_value_t = 300, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1_000_000))]
    frames: u32,
    /// Frames that are drawn before the clock starts.
    #[arg(long, default_value_t = 30, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=1_000_000))]
    warmup: u32,
    /// Samples per pixel at edges (MSAA).
    #[arg(long, default_value = "1", value_name = "N", value_parser = ["1", "4"])]
    msaa: String,
    /// Print rows as JSON.
    #[arg(long)]
    json: bool,
    /// Choice of the graphics card.
    #[command(flatten, next_help_heading = "Graphics card")]
    adapter: AdapterOptions,
    /// Options for reading the data set.
    #[command(flatten, next_help_heading = "Data set")]
    dataset_options: DatasetOptions,
}

/// One scene at one size.
#[derive(Debug, Serialize)]
struct FpsRow {
    /// The scene's file, or "studio".
    scene: String,
    /// Triangles of the scene.
    triangles: usize,
    size: [u32; 2],
    /// 1000 / median milliseconds per frame.
    fps: f64,
    #[serde(flatten)]
    cost: FrameCost,
    /// Bytes of GPU memory per triangle.
    bytes_per_triangle: f64,
    /// PSNR of a frame against the CPU's, dB.
    psnr: f64,
    /// Graphics card, graphics API and driver.
    adapter: String,
}

/// Cost of a frame, over the frames of a path.
#[derive(Debug, Serialize)]
struct FrameCost {
    /// Milliseconds from the end of one frame to the end of the next, with two in flight: median.
    frame_ms: f64,
    /// The 99th percentile, ms.
    frame_p99_ms: f64,
    /// CPU milliseconds per frame, all threads: with a software renderer this is the drawing
    /// itself.
    cpu_ms: f64,
    /// Triangles of the chunks that were drawn, mean.
    drawn: f64,
}

/// A scene and the camera path through it.
struct Flythrough {
    name: String,
    asset: Asset,
    path: Vec<Camera>,
}

/// Measures everything and prints each row as soon as it is there.
pub(crate) fn run(args: &FpsArgs) -> Result<()> {
    let mut card = Headless::new(&args.adapter)?;
    let mut rows = Vec::new();
    eprintln!("{}", card.gpu.describe());
    eprintln!(
        "scene                 triangles        size      FPS   median ms   p99 ms    cpu ms      drawn  B/tri  dB"
    );
    let counts = args.triangles.iter().copied().map(Some);
    let counts: Vec<Option<usize>> =
        if args.file.is_some() { vec![None] } else { counts.collect() };
    for triangles in counts {
        let flythrough = flythrough(args, triangles)?;
        let model = card.upload(&flythrough.asset)?;
        for &size in &args.sizes {
            let row = measure(args, &mut card, &flythrough, &model, size)?;
            let FrameCost { frame_ms, frame_p99_ms, cpu_ms, drawn } = &row.cost;
            eprintln!(
                "{:<20}{:>11}{:>12}{:>9.1}{frame_ms:>12.2}{frame_p99_ms:>9.2}{cpu_ms:>10.1}{drawn:>11.0}{:>7.1}{:>4.0}",
                row.scene,
                row.triangles,
                format!("{}x{}", size.x, size.y),
                row.fps,
                row.bytes_per_triangle,
                row.psnr,
            );
            rows.push(row);
        }
    }
    if args.json { print_json(&rows) } else { Ok(()) }
}

/// Reads the file, or makes the sample scene, and plans the camera path.
fn flythrough(args: &FpsArgs, triangles: Option<usize>) -> Result<Flythrough> {
    let (name, loaded) = match (&args.file, triangles) {
        (Some(file), _) => {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            (name, formats::read(file, &ReadOptions::with_degree(0))?)
        }
        (None, count) => {
            let soup = trisplat_synthetic::soups::studio(count.unwrap_or_default(), 1);
            ("studio".into(), ImportedScene::from(Scene::Soup(soup)))
        }
    };
    let baked = BakedScene::new(loaded)?;
    let path = match &args.dataset {
        Some(path) => {
            let dataset = Dataset::load(path, &args.dataset_options)?;
            dataset.views.iter().map(|view| baked.place(&view.camera, dataset.origin)).collect()
        }
        None => {
            let open = |_| f32::INFINITY;
            let around = |viewpoint| orbit(viewpoint, Vec3::Y, &open, UVec2::new(1280, 960), 36);
            baked.asset.provenance.viewpoint.iter().flat_map(around).collect()
        }
    };
    Ok(Flythrough { name, asset: baked.asset, path })
}

/// One scene at one size.
fn measure(
    args: &FpsArgs,
    card: &mut Headless,
    flythrough: &Flythrough,
    model: &Model,
    size: UVec2,
) -> Result<FpsRow> {
    let path: Vec<Camera> =
        flythrough.path.iter().map(|camera| fit_to_size(camera, size)).collect();
    let first = path.first().ok_or_else(|| Error::invalid("FILE", "empty", "triangles to draw"))?;
    let (picture, _) = card.render(model, &params(first))?;
    let psnr = check(&picture, &flythrough.asset.mesh, first)?;
    let cost = time(args, card, model, &path)?;
    Ok(FpsRow {
        scene: flythrough.name.clone(),
        triangles: flythrough.asset.mesh.face_count(),
        size: size.to_array(),
        fps: 1e3 / cost.frame_ms,
        cost,
        bytes_per_triangle: model.bytes as f64 / model.triangles().max(1) as f64,
        psnr,
        adapter: card.gpu.describe(),
    })
}

/// Draws along a path of cameras and times it.
fn time(args: &FpsArgs, card: &mut Headless, model: &Model, path: &[Camera]) -> Result<FrameCost> {
    let canvas = Canvas::new(&card.gpu, path[0].size, if args.msaa == "4" { 4 } else { 1 })?;
    let mut frame_ms = Vec::new();
    let mut drawn = 0;
    let mut last = None;
    let mut mark = Instant::now();
    let mut cpu = process::cpu_secs();
    let warmup = args.warmup as usize;
    for i in 0..warmup + args.frames as usize + 1 {
        let params = params(&path[i % path.len()]);
        let mut encoder = card.gpu.device.create_command_encoder(&Default::default());
        let stats: DrawStats = card.draw(&mut encoder, &canvas, model, &params)?;
        let submission = card.gpu.queue.submit([encoder.finish()]);
        // Wait for the frame before this one: at most two are in flight.
        if let Some(before) = last.replace(submission) {
            card.gpu.wait(Some(before))?;
        }
        let now = Instant::now();
        if i == warmup {
            cpu = process::cpu_secs();
        } else if i > warmup {
            frame_ms.push((now - mark).as_secs_f64() * 1e3);
            drawn += stats.triangles;
        }
        mark = now;
    }
    let cpu_ms = (process::cpu_secs() - cpu) * 1e3;
    card.gpu.wait(None)?;
    let count = frame_ms.len() as f64;
    Ok(FrameCost {
        frame_ms: quantile(&mut frame_ms, 0.5),
        frame_p99_ms: quantile(&mut frame_ms, 0.99),
        cpu_ms: cpu_ms / count,
        drawn: drawn as f64 / count,
    })
}

fn params(camera: &Camera) -> FrameParams {
    FrameParams { near: NEAR, background: BACKGROUND, ..FrameParams::new(camera) }
}

/// Compares a frame with what the solid rasteriser on the CPU draws, dB.
///
/// # Errors
/// They are not the same picture.
fn check(frame: &RgbImage, mesh: &Mesh, camera: &Camera) -> Result<f64> {
    let options = SolidRasterOptions { background: BACKGROUND, samples: 1, near: NEAR };
    options.validate(camera.size)?;
    let wants = SolidRasterizer::new().render(mesh, camera, &options);
    let psnr = metric::psnr(&frame.rgb, &wants.rgb, None);
    if !(psnr >= MIN_PSNR) {
        return Err(Error::Gpu(format!(
            "another picture than on the CPU at {}x{}: {psnr:.1} dB; update the driver or try another `graphics_api`",
            camera.size.x, camera.size.y
        )));
    }
    Ok(psnr)
}

/// The value below which `share` of them lie; sorts them.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().saturating_sub(1) as f64;
    values.get((share * last).ceil() as usize).copied().unwrap_or(f64::NAN)
}

/// The camera for a picture of another size: the same vertical field of view, wider or narrower.
fn fit_to_size(camera: &Camera, size: UVec2) -> Camera {
    let old = camera.size.as_vec2();
    let new = size.as_vec2();
    let scale = new.y / old.y;
    let center = new / 2.0 + (camera.center - old / 2.0) * scale;
    Camera { focal: camera.focal * scale, center, size, ..*camera }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_values_that_occurred() {
        let mut values = [5.0, 1.0, 4.0, 2.0, 3.0];
        assert_eq!([0.0, 0.5, 0.99, 1.0].map(|q| quantile(&mut values, q)), [1.0, 3.0, 5.0, 5.0]);
        assert!(quantile(&mut [], 0.5).is_nan());
    }
}
