//! From the sums of (splat, tile) pairs to the gradient of every triangle, in a fixed order.

use crate::camera::Camera;
use crate::kernel::clip;
use crate::kernel::sh;
use crate::kernel::splat::Corners;
use crate::math::color::{decode, srgb_from_linear};
use crate::math::lanes::{LANES, prefetch};
use crate::raster::backward::{DRAWN, ERROR, GEOMETRY_SUMS, OPACITY, RGB, SIGMA};
use crate::raster::corners::corner_grads;
use crate::raster::project::{self, CHUNK, Placed, Seen, View};
use crate::raster::soft::{Soft, SoftOptions, SoupGrad, SoupRef};
use glam::Vec3;
use rayon::prelude::*;

/// The rows of one chunk of triangles.
struct Rows<'a> {
    first: usize,
    vertices: &'a mut [[Vec3; 3]],
    opacity: &'a mut [f32],
    sigma: &'a mut [f32],
    sh: &'a mut [[f32; 3]],
    error: &'a mut [f32],
    /// Coefficients per triangle.
    k: usize,
}

/// Fills `out` from `soft.slots`.
pub(super) fn gather(
    soft: &Soft,
    soup: &SoupRef,
    camera: &Camera,
    options: &SoftOptions,
    out: &mut SoupGrad,
) {
    let (n, k) = (soup.len(), soup.sh_count());
    let fits = out.vertices.len() == n && out.sh.len() == n * k;
    if !fits {
        *out = SoupGrad {
            vertices: vec![[Vec3::ZERO; 3]; n],
            opacity: vec![0.0; n],
            sigma: vec![0.0; n],
            sh: vec![[0.0; 3]; n * k],
            error: vec![0.0; n],
            ..SoupGrad::default()
        };
    }
    let view = View::new(camera);
    let stale = std::mem::take(&mut out.visible);
    let rows = out
        .vertices
        .par_chunks_mut(CHUNK)
        .zip(out.opacity.par_chunks_mut(CHUNK))
        .zip(out.sigma.par_chunks_mut(CHUNK))
        .zip(out.sh.par_chunks_mut(CHUNK * k).zip(out.error.par_chunks_mut(CHUNK)))
        .enumerate();
    let found: Vec<(Vec<u32>, usize)> = rows
        .map(|(c, (((vertices, opacity), sigma), (sh, error)))| {
            let mut rows = Rows { first: c * CHUNK, vertices, opacity, sigma, sh, error, k };
            let in_chunk = |t: &u32| (*t as usize) < c * CHUNK;
            let end = |t: &u32| (*t as usize) < (c + 1) * CHUNK;
            for t in &stale[stale.partition_point(in_chunk)..stale.partition_point(end)] {
                rows.zero(*t as usize);
            }
            rows.fill(soft, soup, &view, options, &soft.projection.chunks[c].seen)
        })
        .collect();
    out.visible = stale;
    out.visible.clear();
    out.dropped = 0;
    for (visible, dropped) in found {
        out.visible.extend(visible);
        out.dropped += dropped;
    }
}

impl Rows<'_> {
    fn zero(&mut self, triangle: usize) {
        let i = triangle - self.first;
        self.vertices[i] = [Vec3::ZERO; 3];
        self.opacity[i] = 0.0;
        self.sigma[i] = 0.0;
        self.error[i] = 0.0;
        self.sh[i * self.k..(i + 1) * self.k].fill([0.0; 3]);
    }

    /// Writes the rows of the triangles that were drawn; gives them and the number of non-finite ones.
    fn fill(
        &mut self,
        soft: &Soft,
        soup: &SoupRef,
        view: &View,
        options: &SoftOptions,
        seen: &[Seen],
    ) -> (Vec<u32>, usize) {
        let mut visible = Vec::with_capacity(seen.len());
        let mut dropped = 0;
        let sums = Sums::all(soft, seen, options);
        let corners: Vec<_> = seen.iter().map(|s| corners(s, soup, view, options.near)).collect();
        let d_corners = corner_grads(&corners, &sums, view.focal, options);
        let mut at = 0;
        for pieces in seen.chunk_by(|a, b| a.record.triangle == b.record.triangle) {
            let triangle = pieces[0].record.triangle as usize;
            let mut row = Row::default();
            let mut drawn = false;
            for (i, piece) in (at..).zip(pieces) {
                if sums[i].drawn() {
                    drawn = true;
                    row.add(&sums[i], soup.opacity[triangle]);
                    row.add_corners(&d_corners[i], piece, &soup.vertices[triangle], view, options.near);
                }
            }
            at += pieces.len();
            if drawn {
                let rgb = pieces[0].record.rgb;
                visible.push(triangle as u32);
                dropped += usize::from(!self.write(&row, rgb, triangle, soup, view, options.linear));
            }
        }
        (visible, dropped)
    }

    /// Writes one row; false, and zeros, when it is not finite.
    fn write(
        &mut self,
        row: &Row,
        rgb: [f32; 3],
        triangle: usize,
        soup: &SoupRef,
        view: &View,
        linear: bool,
    ) -> bool {
        let i = triangle - self.first;
        let out = &mut self.sh[i * self.k..(i + 1) * self.k];
        let used = project::active_sh(soup, triangle);
        // The colour is clamped at 0, where nothing passes. In linear light it is clamped at 1 too, as engines do,
        // but there the gradient passes, or a colour too bright could never come back.
        let d_rgb = std::array::from_fn(|c| match rgb[c] > 0.0 {
            true if linear => row.rgb[c] * decode(srgb_from_linear(rgb[c])).1,
            true => row.rgb[c],
            false => 0.0,
        });
        let d_way = color_grad(d_rgb, triangle, soup, view, used, out);
        out[used.len()..].fill([0.0; 3]);
        let vertices = row.vertices.map(|v| v + d_way * (1.0 / 3.0));
        let finite = d_rgb.iter().all(|d| d.is_finite())
            && vertices.iter().all(|v| v.is_finite())
            && row.opacity.is_finite()
            && row.sigma.is_finite();
        if !finite {
            self.zero(triangle);
            return false;
        }
        self.vertices[i] = vertices;
        self.opacity[i] = row.opacity;
        self.sigma[i] = row.sigma;
        self.error[i] = row.error;
        true
    }
}

/// Gradients of the coefficients into `out`; gives ∂L/∂(centroid - camera).
fn color_grad(
    d: [f32; 3],
    triangle: usize,
    soup: &SoupRef,
    view: &View,
    used: &[[f32; 3]],
    out: &mut [[f32; 3]],
) -> Vec3 {
    let degree = soup.active_degree.min(soup.sh_degree);
    let (unit, length) = project::direction(view, &soup.vertices[triangle]);
    let basis = sh::basis(degree, unit);
    let mut d_basis = [0.0f32; sh::MOST];
    for (i, coefficient) in used.iter().enumerate() {
        out[i] = d.map(|d| d * basis[i]);
        d_basis[i] = coefficient[0] * d[0] + coefficient[1] * d[1] + coefficient[2] * d[2];
    }
    if degree == 0 || !(length > 0.0) {
        return Vec3::ZERO;
    }
    let d_unit = sh::basis_grad(degree, unit, &d_basis);
    project::vec3(sh::normalize_grad(unit, length, d_unit))
}

/// The corners of a piece in camera space.
fn corners(seen: &Seen, soup: &SoupRef, view: &View, near: f32) -> Corners<f32> {
    Placed::new(view, &soup.vertices[seen.record.triangle as usize]).piece(&seen.piece, near)
}

/// All pairs of a splat summed.
#[derive(Clone, Copy)]
pub(super) struct Sums {
    pub(super) base: [f32; LANES],
    pub(super) geometry: [f32; GEOMETRY_SUMS],
}

impl Sums {
    /// The sums of every splat of a chunk. A loop of its own: its many scattered reads then overlap.
    fn all(soft: &Soft, seen: &[Seen], options: &SoftOptions) -> Vec<Self> {
        let pairs = |seen: &Seen| {
            let place = seen.place as usize;
            &soft.tiles.entry_of_pair[soft.tiles.pairs[place] as usize..soft.tiles.pairs[place + 1] as usize]
        };
        let mut out = Vec::with_capacity(seen.len());
        for (i, s) in seen.iter().enumerate() {
            if let Some(ahead) = seen.get(i + AHEAD) {
                pairs(ahead).iter().for_each(|entry| prefetch(&soft.slots[*entry as usize]));
            }
            if let Some(entry) = seen.get(i + 3 * AHEAD).and_then(|ahead| pairs(ahead).first()) {
                prefetch(entry);
            }
            out.push(Self::of(soft, pairs(s), options));
        }
        out
    }

    fn of(soft: &Soft, pairs: &[u32], options: &SoftOptions) -> Self {
        let mut out = Self { base: [0.0; LANES], geometry: [0.0; GEOMETRY_SUMS] };
        for entry in pairs {
            let slot = &soft.slots[*entry as usize].0;
            for (sum, value) in out.base.iter_mut().zip(slot) {
                *sum += value;
            }
            if options.geometry && slot[DRAWN] > 0.0 {
                for (sum, value) in out.geometry.iter_mut().zip(&soft.geometry_slots[*entry as usize]) {
                    *sum += value;
                }
            }
        }
        out
    }

    /// Whether the splat was drawn at all.
    fn drawn(&self) -> bool {
        self.base[DRAWN] > 0.0
    }
}

/// How many splats ahead their slots are asked for.
const AHEAD: usize = 8;

/// Gradient of one triangle, but for the SH.
#[derive(Default)]
struct Row {
    vertices: [Vec3; 3],
    opacity: f32,
    sigma: f32,
    rgb: [f32; 3],
    error: f32,
}

impl Row {
    /// Adds what needs no geometry. A sum is ∂L/∂log(effective opacity), so ∂L/∂log of each of its factors.
    fn add(&mut self, sums: &Sums, opacity: f32) {
        for c in 0..3 {
            self.rgb[c] += sums.base[RGB + c];
        }
        self.opacity += sums.base[OPACITY] / opacity;
        self.sigma += sums.base[SIGMA];
        self.error += sums.base[ERROR];
    }

    /// Adds to the vertices in the world what the corners of a piece in camera space give.
    fn add_corners(&mut self, d: &Corners<f32>, seen: &Seen, triangle: &[Vec3; 3], view: &View, near: f32) {
        let back = view.rotation.transpose();
        let each = [d.first - d.edges[0] - d.edges[1], d.edges[0], d.edges[1]];
        if seen.piece == clip::WHOLE {
            for (vertex, d) in self.vertices.iter_mut().zip(each) {
                *vertex += back * project::vec3(d);
            }
            return;
        }
        let placed = Placed::new(view, triangle);
        for (corner, d) in seen.piece.iter().zip(each) {
            let (from, to) = (corner.from as usize, corner.to as usize);
            if from == to {
                self.vertices[from] += back * project::vec3(d);
            } else {
                let (d_from, d_to) = clip::near_point_grad(placed.corners[from], placed.corners[to], near, d);
                self.vertices[from] += back * project::vec3(d_from);
                self.vertices[to] += back * project::vec3(d_to);
            }
        }
    }
}
