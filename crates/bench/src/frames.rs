//! How long the graphics card takes for a frame.

use glam::UVec2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Instant;
use trisplat_gpu::Timer;
use trisplat_raster::solid::{SolidRasterOptions, SolidRasterizer};
use trisplat_scene::{Error, Result, camera::Camera, image::RgbImage, mesh::Mesh, process};
use trisplat_view::{Canvas, DisplayMode, DrawStats, FrameParams, Headless, Model};

/// Background colour: one that no scene is likely to have, so that holes are seen.
pub(super) const BACKGROUND: [f32; 3] = [1.0, 0.0, 1.0];
/// Least agreement of a frame with the solid rasteriser on the CPU that counts as the same picture, dB.
const LEAST_PSNR: f64 = 30.0;

/// How many frames are drawn.
#[derive(Debug, Clone, Copy)]
pub(super) struct FrameCount {
    /// Frames before the clock starts.
    pub(super) warmup: usize,
    /// Frames that are timed.
    pub(super) frames: usize,
}

/// What a frame costs, over the frames of a path.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FrameCost {
    /// Milliseconds from the end of one frame to the end of the next, with two in flight: median.
    pub frame_ms: f64,
    /// The 99th percentile, ms.
    pub frame_p99_ms: f64,
    /// The fastest frame, ms: nearest to what an idle machine does.
    pub frame_min_ms: f64,
    /// Milliseconds by the timestamps of the graphics card, median; null where it has none.
    pub gpu_ms: Option<f64>,
    /// CPU milliseconds per frame, all threads: with a software renderer this is the drawing itself.
    pub cpu_ms: f64,
    /// Triangles of the chunks that were drawn, mean.
    pub drawn: f64,
    /// Draw calls, mean.
    pub draws: f64,
}

/// Draws along a path of cameras and times it.
pub(super) fn time(
    card: &mut Headless,
    model: &Model,
    path: &[Camera],
    msaa: u32,
    count: FrameCount,
) -> Result<FrameCost> {
    let Some(first) = path.first() else {
        return Err(Error::invalid("camera path", "empty", "at least one camera"));
    };
    let canvas = Canvas::new(&card.gpu, first.size, msaa)?;
    let mut timer = Timer::new(&card.gpu);
    let mut times = FrameTimes::default();
    let (mut last, mut mark, mut cpu) = (None, Instant::now(), process::cpu_secs());
    for i in 0..count.warmup + count.frames + 1 {
        let params = params(&path[i % path.len()]);
        let mut encoder = card.gpu.device.create_command_encoder(&Default::default());
        let slot = timer.as_mut().and_then(Timer::begin);
        let timestamps = slot.and_then(|slot| timer.as_ref().map(|t| t.writes(slot)));
        let stats = card.draw(&mut encoder, &canvas, model, &params, timestamps)?;
        if let (Some(timer), Some(slot)) = (&mut timer, slot) {
            timer.end(slot, &mut encoder);
        }
        let submission = card.gpu.queue.submit([encoder.finish()]);
        if let Some(timer) = &mut timer {
            timer.submitted();
        }
        // Wait for the frame before this one: at most two are in flight.
        if let Some(before) = last.replace(submission) {
            card.gpu.wait(Some(before))?;
        }
        let now = Instant::now();
        if i == count.warmup {
            cpu = process::cpu_secs();
        }
        let gpu_ms = timer.as_mut().map_or(Vec::new(), Timer::collect);
        if i > count.warmup {
            times.add((now - mark).as_secs_f64() * 1e3, gpu_ms, stats);
        }
        mark = now;
    }
    let cpu_ms = (process::cpu_secs() - cpu) * 1e3;
    card.gpu.wait(None)?;
    Ok(times.cost(cpu_ms))
}

/// What was measured of each frame.
#[derive(Debug, Default)]
struct FrameTimes {
    frame_ms: Vec<f64>,
    gpu_ms: Vec<f64>,
    drawn: u64,
    draws: u64,
}

impl FrameTimes {
    fn add(&mut self, frame_ms: f64, gpu_ms: Vec<f64>, stats: DrawStats) {
        self.frame_ms.push(frame_ms);
        self.gpu_ms.extend(gpu_ms);
        self.drawn += stats.triangles;
        self.draws += u64::from(stats.draws);
    }

    /// The cost per frame; `cpu_ms` is that of all frames.
    fn cost(mut self, cpu_ms: f64) -> FrameCost {
        let count = self.frame_ms.len() as f64;
        let gpu_ms = (!self.gpu_ms.is_empty()).then(|| quantile(&mut self.gpu_ms, 0.5));
        FrameCost {
            frame_ms: quantile(&mut self.frame_ms, 0.5),
            frame_p99_ms: quantile(&mut self.frame_ms, 0.99),
            frame_min_ms: quantile(&mut self.frame_ms, 0.0),
            gpu_ms,
            cpu_ms: cpu_ms / count,
            drawn: self.drawn as f64 / count,
            draws: self.draws as f64 / count,
        }
    }
}

fn params(camera: &Camera) -> FrameParams<'static> {
    let (display, background) = (DisplayMode::Color, BACKGROUND);
    FrameParams {
        camera: *camera,
        near: NEAR,
        background,
        display,
        wireframe: false,
        subset: None,
        level_bias: 0.0,
    }
}

const NEAR: f32 = 0.01;

/// One frame, drawn and read back.
pub(super) fn picture(card: &mut Headless, model: &Model, camera: &Camera) -> Result<RgbImage> {
    let canvas = Canvas::new(&card.gpu, camera.size, 1)?;
    let mut encoder = card.gpu.device.create_command_encoder(&Default::default());
    card.draw(&mut encoder, &canvas, model, &params(camera), None)?;
    card.gpu.queue.submit([encoder.finish()]);
    canvas.pixels(&card.gpu)
}

/// How close a frame comes to what the solid rasteriser on the CPU draws.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Agreement {
    /// Peak signal-to-noise ratio, dB; 99 for equal pictures.
    pub psnr: f64,
    /// Share of the pixels that are more than one code off, of 1.
    pub off: f64,
}

/// Compares a frame with the CPU's. Errors: they are not the same picture.
pub(super) fn check(name: &str, frame: &RgbImage, mesh: &Mesh, camera: &Camera) -> Result<Agreement> {
    let options = SolidRasterOptions { background: BACKGROUND, samples: 1, near: NEAR };
    options.validate(camera.size)?;
    let wants = SolidRasterizer::new().render(mesh, camera, &options);
    let agreement = agreement(frame, &wants);
    if !(agreement.psnr >= LEAST_PSNR) {
        let what =
            format!("{name} at {}x{} draws another picture than the CPU", camera.size.x, camera.size.y);
        return Err(Error::Gpu(format!(
            "{what}: {:.1} dB; update the driver or try another `graphics_api`",
            agreement.psnr
        )));
    }
    Ok(agreement)
}

fn agreement(a: &RgbImage, b: &RgbImage) -> Agreement {
    let pairs = || a.rgb.iter().zip(&b.rgb);
    let squares: u64 = pairs().flat_map(|(p, q)| (0..3).map(|c| u64::from(p[c].abs_diff(q[c])).pow(2))).sum();
    let off = pairs().filter(|(p, q)| (0..3).any(|c| p[c].abs_diff(q[c]) > 1)).count();
    let mean = squares as f64 / (3 * a.rgb.len().max(1)) as f64;
    let psnr = if mean > 0.0 { (10.0 * (255.0f64.powi(2) / mean).log10()).min(99.0) } else { 99.0 };
    Agreement { psnr, off: off as f64 / a.rgb.len().max(1) as f64 }
}

/// The value below which `share` of them lie; sorts them. NaN of none.
pub(super) fn quantile(values: &mut [f64], share: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let last = values.len().saturating_sub(1) as f64;
    values.get((share * last).ceil() as usize).copied().unwrap_or(f64::NAN)
}

/// The camera for a picture of another size: the same vertical field of view, wider or narrower.
pub(super) fn fitted(camera: &Camera, size: UVec2) -> Camera {
    let (old, new) = (camera.size.as_vec2(), size.as_vec2());
    let scale = new.y / old.y;
    Camera {
        focal: camera.focal * scale,
        center: new / 2.0 + (camera.center - old / 2.0) * scale,
        size,
        ..*camera
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_screen_does_not_agree() {
        let size = UVec2::new(4, 2);
        let full = RgbImage { size, rgb: (0..8).map(|i| [30 * i, 9, 200 - i]).collect(), alpha: None };
        let empty = RgbImage { size, rgb: vec![[255, 0, 255]; 8], alpha: None };
        assert!(agreement(&empty, &full).psnr < 15.0);
        assert_eq!(agreement(&full, &full), Agreement { psnr: 99.0, off: 0.0 });
        let mut near = full.clone();
        near.rgb[3][1] += 2;
        assert_eq!(agreement(&near, &full).off, 0.125);
    }

    #[test]
    fn quantiles_are_values_that_occurred() {
        let mut values = [5.0, 1.0, 4.0, 2.0, 3.0];
        assert_eq!([0.0, 0.5, 0.99, 1.0].map(|q| quantile(&mut values, q)), [1.0, 3.0, 5.0, 5.0]);
        assert!(quantile(&mut [], 0.5).is_nan());
    }
}
