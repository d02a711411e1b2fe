//! The solid rasteriser: what an engine draws, defined on the CPU.
//!
//! ```text
//! faces ──► project, cut, bin ──► tiles ──► fill (nearest face of every sample) ──► resolve ──► Pixels
//!                                                                              └──► export ──► Visibility
//! ```
//!
//! The definition, which every other renderer of ours is held against:
//!
//! * A triangle is cut at the near plane and at a guard band far outside the picture; both sides are drawn;
//!   opacity is ignored: everything is opaque.
//! * Corners are snapped to 1/256 of a sample, as GPUs do; from there on edge functions are exact, so a shared
//!   edge neither gaps nor overlaps. A sample on an edge belongs to the triangle that has it on its top or left.
//! * Samples lie at the centres of a regular grid of N x N a pixel.
//! * The nearest face wins: greatest 1/z, which is affine on the screen; ties go to the lower face index. This
//!   does not depend on the order of drawing, hence not on the number of threads.
//! * Colours are interpolated perspective-correctly in linear light, averaged over a pixel's samples in linear
//!   light, then sRGB-encoded and rounded.

mod bin;
mod clip;
mod eye;
mod fill;
mod resolve;
mod shade;
mod spans;

use crate::camera::Camera;
use crate::error::{Error, Result};
use crate::image::Pixels;
use crate::mesh::Mesh;
use bin::Batch;
use eye::Eye;
use glam::UVec2;
use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// The face of a sample that sees nothing.
pub const NO_FACE: u32 = u32::MAX;
/// Most samples along an axis of the picture: beyond it corners have no 1/256 of a sample any more.
pub const MOST_SAMPLES: u32 = 1 << 15;

/// How to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SolidOptions {
    /// Colour behind everything, sRGB-encoded.
    pub background: [f32; 3],
    /// Samples a pixel along each axis: 1, 2 or 4.
    pub samples: u32,
    /// Depth of the near plane in units of the mesh, > 0. Depth precision does not depend on it.
    pub near: f32,
}

impl Default for SolidOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], samples: 1, near: 0.01 }
    }
}

impl SolidOptions {
    /// Checks the ranges, and that a picture of `size` has at most [`MOST_SAMPLES`] along each axis.
    pub fn validate(&self, size: UVec2) -> Result<()> {
        if !matches!(self.samples, 1 | 2 | 4) {
            return Err(Error::invalid("samples", self.samples, "1, 2 or 4"));
        }
        if !(self.near > 0.0 && self.near.is_finite()) {
            return Err(Error::invalid("near", self.near, "a depth above 0"));
        }
        let most = u64::from(size.max_element()) * u64::from(self.samples);
        if most > u64::from(MOST_SAMPLES) {
            let wants = format!("a picture of at most {} px a side", MOST_SAMPLES / self.samples);
            return Err(Error::invalid("samples", format!("{} on {size} px", self.samples), wants));
        }
        Ok(())
    }
}

/// Which face each sample sees. `[height * width]`, row by row, in samples
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Visibility {
    /// Width and height, samples: the camera's size times the samples along an axis.
    pub size: UVec2,
    /// Face seen, or [`NO_FACE`].
    pub face: Vec<u32>,
    /// Depth z in the camera's frame, units of the mesh; infinite where nothing is seen.
    pub depth: Vec<f32>,
}

impl Visibility {
    /// Perspective-correct weights of the corners of the face seen at a sample: what colours are mixed with.
    /// In [0, 1], sum 1. Zeros where nothing is seen. Mesh and camera must be those that were drawn.
    pub fn barycentrics(&self, mesh: &Mesh, camera: &Camera, x: u32, y: u32) -> [f32; 3] {
        let face = self.face[(y * self.size.x + x) as usize];
        if face == NO_FACE {
            return [0.0; 3];
        }
        let weigher = Weigher::new(mesh, camera, self.size.x / camera.size.x);
        weigher.weights(&weigher.corners(face), x, y)
    }
}

/// A face as perspective-correct weights of its corners need it.
pub use shade::Corners;

/// [`Visibility::barycentrics`] for many samples of few faces.
#[derive(Debug, Clone)]
pub struct Weigher<'a> {
    mesh: &'a Mesh,
    eye: Eye,
}

impl<'a> Weigher<'a> {
    /// For the mesh and camera that were drawn with so many samples along each axis of a pixel.
    pub fn new(mesh: &'a Mesh, camera: &Camera, samples: u32) -> Self {
        Self { mesh, eye: Eye::new(camera, samples, 0.0) }
    }

    /// What [`Weigher::weights`] needs to know of a face.
    pub fn corners(&self, face: u32) -> Corners {
        Corners::new(&self.eye, self.mesh.corners(face as usize))
    }

    /// The same in the middle of a pixel of so many samples along each axis.
    #[inline(always)]
    pub fn weights_in_pixel(&self, corners: &Corners, x: u32, y: u32) -> [f32; 3] {
        corners.weights(self.eye.ray_in_pixel(x, y))
    }

    /// Perspective-correct weights of a face's corners at a sample; in [0, 1], sum 1.
    #[inline(always)]
    pub fn weights(&self, corners: &Corners, x: u32, y: u32) -> [f32; 3] {
        corners.weights(self.eye.ray(x, y))
    }
}

/// Time spent in the parts of a frame that take turns, summed over threads, ns.
#[derive(Debug, Default)]
struct Parts {
    fill: AtomicU64,
    resolve: AtomicU64,
}

impl Parts {
    /// Counts the time since `start` for `part`; returns now.
    fn lap(part: &AtomicU64, start: Instant) -> Instant {
        let now = Instant::now();
        part.fetch_add((now - start).as_nanos() as u64, Relaxed);
        now
    }

    fn split(&self, binned: Duration, end: Duration) -> Vec<(&'static str, f64)> {
        let (fill, resolve) = (self.fill.load(Relaxed) as f64, self.resolve.load(Relaxed) as f64);
        let rest = (end - binned).as_secs_f64() * 1e3 / (fill + resolve).max(1.0);
        vec![("bin", binned.as_secs_f64() * 1e3), ("fill", fill * rest), ("resolve", resolve * rest)]
    }
}

/// The rasteriser: scratch memory that is reused from frame to frame.
#[derive(Debug, Default)]
pub struct Solid {
    batches: Vec<Batch>,
    visibility: Visibility,
    timings: Vec<(&'static str, f64)>,
}

impl Solid {
    /// A rasteriser with nothing allocated yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The picture that `camera` sees, in 8 bits. The same bytes for any number of threads.
    ///
    /// The mesh must be sound ([`Mesh::validate_shape`]) and the options valid for the camera's size.
    pub fn render(&mut self, mesh: &Mesh, camera: &Camera, options: &SolidOptions) -> Pixels {
        let clock = Instant::now();
        let eye = Eye::new(camera, options.samples, options.near);
        bin::bin(&mut self.batches, mesh, &eye);
        let binned = clock.elapsed();
        let parts = Parts::default();
        let picture = resolve::picture(&self.batches, mesh, &eye, options, &parts);
        self.timings = parts.split(binned, clock.elapsed());
        picture
    }

    /// The face and depth that every sample sees.
    pub fn visibility(&mut self, mesh: &Mesh, camera: &Camera, options: &SolidOptions) -> &Visibility {
        let clock = Instant::now();
        let eye = Eye::new(camera, options.samples, options.near);
        bin::bin(&mut self.batches, mesh, &eye);
        let binned = clock.elapsed();
        let parts = Parts::default();
        resolve::export(&self.batches, &eye, &mut self.visibility, &parts);
        self.timings = parts.split(binned, clock.elapsed());
        &self.visibility
    }

    /// Wall time of every part of the last frame, ms: "bin", "fill", "resolve". The last two take turns, tile by
    /// tile; each gets its share.
    pub fn timings(&self) -> &[(&'static str, f64)] {
        &self.timings
    }
}
