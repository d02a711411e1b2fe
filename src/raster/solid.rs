//! The solid rasteriser: what an engine draws, defined on the CPU.
//!
//! ```text
//! faces ──► project, clip, bin ──► tiles ──► fill (nearest face of every sample) ──► resolve ──► Pixels
//!                                                                              └──► export ──► Visibility
//! ```
//!
//! The definition that every other renderer of this project is compared with:
//!
//! * A triangle is clipped at the near plane and at a guard band far outside the picture; both sides are drawn;
//!   opacity is ignored: everything is opaque.
//! * Corners are snapped to 1/256 of a sample, as GPUs do; from there on edge functions are exact, so a shared
//!   edge neither gaps nor overlaps. A sample on an edge belongs to the triangle for which it is a top or left edge.
//! * Samples lie at the centres of a regular grid of N x N per pixel.
//! * The nearest face wins: greatest 1/z, which is affine on the screen; ties go to the lower face index. This
//!   does not depend on the order of drawing, hence not on the number of threads.
//! * Colours are interpolated perspective-correctly in linear light, averaged over a pixel's samples in linear
//!   light, then sRGB-encoded and rounded.

mod barycentric;
mod bin;
mod bins;
mod clip;
mod fill;
mod keys;
mod options;
mod planes;
mod projector;
mod resolve;
mod shade;
mod spans;
mod timing;
mod visibility;

pub use barycentric::{Barycentrics, FaceBarycentrics};
pub use options::{MAX_SAMPLES, SolidRasterOptions};
pub use planes::{Nearest, PlaneTile};
pub use visibility::{NO_FACE, Visibility};

use crate::camera::Camera;
use crate::image::Pixels;
use crate::mesh::Mesh;
use bins::Batch;
use projector::Projector;
use std::time::Instant;
use timing::PartTimes;

/// The rasteriser: scratch memory that is reused from frame to frame.
#[derive(Debug, Default)]
pub struct Solid {
    batches: Vec<Batch>,
    visibility: Visibility,
    timings: Vec<(&'static str, f64)>,
}

impl Solid {
    /// A rasteriser without scratch memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// The picture that `camera` sees, in 8 bits. The same bytes for any number of threads.
    ///
    /// The mesh must be valid ([`Mesh::validate_shape`]) and the options valid for the camera's size.
    pub fn render(&mut self, mesh: &Mesh, camera: &Camera, options: &SolidRasterOptions) -> Pixels {
        let clock = Instant::now();
        let projector = Projector::new(camera, options.samples, options.near);
        bin::bin(&mut self.batches, mesh, &projector);
        let binned = clock.elapsed();
        let parts = PartTimes::default();
        let picture = resolve::picture(&self.batches, mesh, &projector, options, &parts);
        self.timings = parts.split(binned, clock.elapsed());
        picture
    }

    /// The face and depth that every sample sees.
    pub fn visibility(&mut self, mesh: &Mesh, camera: &Camera, options: &SolidRasterOptions) -> &Visibility {
        let clock = Instant::now();
        let projector = Projector::new(camera, options.samples, options.near);
        bin::bin(&mut self.batches, mesh, &projector);
        let binned = clock.elapsed();
        let parts = PartTimes::default();
        resolve::export(&self.batches, &projector, &mut self.visibility, &parts);
        self.timings = parts.split(binned, clock.elapsed());
        &self.visibility
    }

    /// What every sample sees of the faces of each plane: face f belongs to plane `plane_of[f]` of `planes`. Tiles are
    /// given to `on_tile` several at a time and in any order. `[F]`
    pub fn planes(
        &mut self,
        mesh: &Mesh,
        camera: &Camera,
        options: &SolidRasterOptions,
        (planes, plane_of): (usize, &[u8]),
        on_tile: impl Fn(&PlaneTile<'_>) + Sync,
    ) {
        let projector = Projector::new(camera, options.samples, options.near);
        bin::bin(&mut self.batches, mesh, &projector);
        planes::planes(&self.batches, &projector, (planes, plane_of), on_tile);
    }

    /// Wall time of every part of the last frame, ms: "bin", "fill", "resolve". The last two alternate, tile
    /// by tile; each gets its share.
    pub fn timings(&self) -> &[(&'static str, f64)] {
        &self.timings
    }
}
