//! Projects world triangles to splats on the screen, and orders them front to back.

use super::camera_space::{KernelCamera, UnclippedTriangle, direction};
use super::options::SoftOptions;
use super::pieces::PieceGroup;
use super::sort::{self, DepthKey};
use super::soup_ref::SoupRef;
use super::splats::{CHUNK, Projection, SplatChunk};
use crate::kernel::clip;
use crate::kernel::sh;
use std::ops::Range;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::math::lanes::{Lanes, Work, dispatch};
use trisplat_scene::math::vec::V3;
use trisplat_scene::parallel::{self, GRAIN};

impl Projection {
    /// Projects the triangles of a soup, chunk by chunk.
    pub(super) fn project(&mut self, soup: &SoupRef, camera: &Camera, options: &SoftOptions) {
        let camera = KernelCamera::new(camera);
        self.triangles = soup.len();
        self.chunks.resize_with(soup.len().div_ceil(CHUNK), SplatChunk::default);
        parallel::for_each(&mut self.chunks, |c, chunk| {
            let triangles = c * CHUNK..((c + 1) * CHUNK).min(soup.len());
            dispatch(ProjectChunk { chunk, triangles, soup, camera: &camera, options });
        });
    }

    /// Fills the splats, front to back.
    pub(super) fn order(&mut self) {
        self.keys.clear();
        for (c, chunk) in self.chunks.iter().enumerate() {
            // At most two splats per triangle, so the index in a chunk fits in 11 bits.
            let key =
                |(i, depth): (usize, &u32)| DepthKey { depth: *depth, index: (c * 2 * CHUNK + i) as u32 };
            self.keys.extend(chunk.depths.iter().enumerate().map(key));
        }
        sort::by_depth(&mut self.keys, &mut self.scratch);
        for (rank, key) in self.keys.iter().enumerate() {
            let from = key.index as usize;
            self.chunks[from / (2 * CHUNK)].projected[from % (2 * CHUNK)].rank = rank as u32;
        }
        let chunks = &self.chunks;
        let projected = |key: &DepthKey| {
            &chunks[key.index as usize / (2 * CHUNK)].projected[key.index as usize % (2 * CHUNK)]
        };
        let (keys, splats) = (&self.keys, &mut self.splats);
        splats.records.clear();
        parallel::extend(&mut splats.records, keys.len(), GRAIN, |i| projected(&keys[i]).record);
        splats.bounds.clear();
        parallel::extend(&mut splats.bounds, keys.len(), GRAIN, |i| projected(&keys[i]).bounds);
        splats.planes.clear();
        parallel::extend(&mut splats.planes, keys.len(), GRAIN, |i| projected(&keys[i]).plane);
    }
}

/// The triangles of one chunk.
struct ProjectChunk<'a> {
    chunk: &'a mut SplatChunk,
    triangles: Range<usize>,
    soup: &'a SoupRef<'a>,
    camera: &'a KernelCamera,
    options: &'a SoftOptions,
}

impl Work for ProjectChunk<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        self.chunk.projected.clear();
        self.chunk.depths.clear();
        let (soup, near) = (self.soup, self.options.near);
        let mut group = PieceGroup::default();
        for i in self.triangles.clone() {
            if !(soup.opacity[i] > self.options.cutoff) {
                continue;
            }
            let unclipped = UnclippedTriangle::new(self.camera, &soup.vertices[i]);
            let (pieces, count) = clip::pieces(unclipped.corners.map(|v| v.z >= near));
            for piece in &pieces[..count] {
                group.push(&unclipped.piece(piece, near), piece, i as u32, soup.opacity[i], soup.sigma[i]);
                if group.is_full() {
                    self.finish::<L>(&mut group);
                }
            }
        }
        self.finish::<L>(&mut group);
    }
}

impl ProjectChunk<'_> {
    /// Adds the splats of the pieces that are drawn; leaves the group empty.
    #[inline(always)]
    fn finish<L: Lanes>(&mut self, group: &mut PieceGroup) {
        let SplatChunk { projected, depths } = &mut *self.chunk;
        let first = projected.len();
        group.project::<L>(self.camera, self.options, projected, depths);
        let mut last = (u32::MAX, [0.0; 3]);
        for splat in &mut projected[first..] {
            let triangle = splat.record.triangle;
            if last.0 != triangle {
                last = (triangle, color(self.soup, triangle as usize, self.camera, self.options.linear));
            }
            splat.record.rgb = last.1;
        }
    }
}

/// Colour of a triangle in the encoding of blending.
#[inline]
fn color(soup: &SoupRef, triangle: usize, camera: &KernelCamera, linear: bool) -> [f32; 3] {
    let degree = soup.active_degree.min(soup.sh_degree);
    // At degree 0 it does not depend on the direction.
    let unit = if degree == 0 { V3::zero() } else { direction(camera, &soup.vertices[triangle]).0 };
    let basis = sh::basis(degree, unit);
    let rgb = raw_color(&basis, soup.active_sh(triangle)).map(|c| c.max(0.0));
    if linear { rgb.map(linear_from_srgb) } else { rgb }
}

/// Colour of a triangle before the clamp at 0.
#[inline]
fn raw_color(basis: &[f32; sh::MAX_COEFFICIENTS], coefficients: &[[f32; 3]]) -> [f32; 3] {
    let mut rgb = [0.5f32; 3];
    for (weight, coefficient) in basis.iter().zip(coefficients) {
        for channel in 0..3 {
            rgb[channel] += weight * coefficient[channel];
        }
    }
    rgb
}
