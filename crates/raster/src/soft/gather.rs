//! Gathers the gradients of (splat, tile) pairs into those of the triangles, in a fixed order;
//! those of corners sixteen splats at once.

use super::frame::{SoftOptions, SoupGrad, SoupRef, Window};
use super::projected::{
    CHUNK, Columns, KernelCamera, ProjectedSplat, SplatChunk, UnclippedTriangle, broadcast,
    columns, direction, flat, load2, load3, put, triangles, vec3,
};
use super::slots::{ERROR, GEOMETRY_SUMS, GradSlots, OPACITY, RATIO, RGB, SIGMA, SplatSums};
use super::tiles::Tiles;
use crate::kernel::sh;
use crate::kernel::splat::{self, CameraTriangle, DepthPlaneGrad, SplatGrad};
use glam::Vec3;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::color::{decode, srgb_from_linear};
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::math::real::{V2, V3};
use trisplat_scene::parallel;

/// Gradient of the corners of every splat; arbitrary for one that was not drawn.
struct CornerGrads<'a> {
    corners: &'a [CameraTriangle<f32>],
    sums: &'a [SplatSums],
    focal: V2<f32>,
    options: &'a SoftOptions,
}

/// Number of a splat's sums from [`OPACITY`] on.
const SUM_NUMBERS: usize = RATIO + 9 - OPACITY;

impl Work for CornerGrads<'_> {
    type Output = Vec<CameraTriangle<f32>>;
    #[inline(always)]
    fn run<L: Lanes>(self) -> Vec<CameraTriangle<f32>> {
        let mut out = Vec::with_capacity(self.corners.len());
        let mut corners: Columns<9> = [[0.0; LANES]; 9];
        let mut base: Columns<SUM_NUMBERS> = [[0.0; LANES]; SUM_NUMBERS];
        let mut geometry: Columns<GEOMETRY_SUMS> = [[0.0; LANES]; GEOMETRY_SUMS];
        for (some, sums) in self.corners.chunks(LANES).zip(self.sums.chunks(LANES)) {
            for (lane, (c, s)) in some.iter().zip(sums).enumerate() {
                put(&mut corners, lane, &flat(c));
                put(&mut base, lane, s.base[OPACITY..].first_chunk().expect("as many sums"));
                put(&mut geometry, lane, &s.geometry);
            }
            corners =
                columns(flat(&grads::<L>(&corners, &base, &geometry, self.focal, self.options)));
            for (lane, _) in some.iter().enumerate() {
                let at = |i: usize| {
                    V3::new(corners[i][lane], corners[i + 1][lane], corners[i + 2][lane])
                };
                out.push(CameraTriangle { first: at(0), edges: [at(3), at(6)] });
            }
        }
        out
    }
}

/// The gradients of corners.
#[inline(always)]
fn grads<L: Lanes>(
    corners: &Columns<9>,
    base: &Columns<SUM_NUMBERS>,
    geometry: &Columns<GEOMETRY_SUMS>,
    focal: V2<f32>,
    options: &SoftOptions,
) -> CameraTriangle<L> {
    let corners = triangles(corners);
    let focal = broadcast(focal);
    let splat = splat::splat(&corners, focal, V2::zero());
    let full_px = L::splat(options.fade_px);
    let by_fade = splat::fade_grad(splat.inradius, full_px) / splat::fade(splat.inradius, full_px);
    // Distances from the edges are ratios times an inradius, in which a constant inradius cancels.
    let (scale, by_inradius, by_incenter) = match options.window {
        Window::Soft => (L::splat(1.0), by_fade, L::splat(1.0)),
        Window::Coverage { width_px } => {
            (splat.inradius / L::splat(width_px), L::splat(0.0), L::splat(0.0))
        }
    };
    let first = RATIO - OPACITY;
    let ratio = |i: usize| L::load(&base[first + 3 * i]) * scale;
    let moment = |i: usize| load2::<L>(base, first + 3 * i + 1).scale(scale);
    let d = SplatGrad {
        ratio: [ratio(0), ratio(1), ratio(2)],
        moment: [moment(0), moment(1), moment(2)],
        inradius: L::load(&base[0]) * by_inradius,
        by_incenter,
    };
    let mut out = splat::splat_grad(&corners, focal, &splat, &d);
    if options.geometry {
        let d = DepthPlaneGrad {
            inv_depth: L::load(&geometry[0]),
            slope: load2(geometry, 1),
            normal: load3(geometry, 3),
        };
        let more = splat::depth_plane_grad(
            &corners,
            focal,
            &splat,
            &splat::depth_plane(&corners, focal),
            &d,
        );
        out.first = out.first + more.first;
        out.edges = [out.edges[0] + more.edges[0], out.edges[1] + more.edges[1]];
    }
    out
}

/// The rows of one chunk of triangles.
struct GradRows<'a> {
    soup: &'a SoupRef<'a>,
    camera: &'a KernelCamera,
    options: &'a SoftOptions,
    first: usize,
    vertices: &'a mut [[Vec3; 3]],
    opacity: &'a mut [f32],
    sigma: &'a mut [f32],
    sh: &'a mut [[f32; 3]],
    error: &'a mut [f32],
    /// Coefficients per triangle.
    k: usize,
}

/// The sums of the backward pass, and the place of each splat's sums.
pub(super) struct PairGrads<'a> {
    pub(super) chunks: &'a [SplatChunk],
    pub(super) tiles: &'a Tiles,
    pub(super) slots: &'a GradSlots,
}

/// Fills `out` from the sums of all pairs.
pub(super) fn gather(
    pairs: &PairGrads,
    soup: &SoupRef,
    camera: &Camera,
    options: &SoftOptions,
    out: &mut SoupGrad,
) {
    let n = soup.count();
    let k = soup.sh_count();
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
    let camera = &KernelCamera::new(camera);
    let stale = SoupGrad { visible: std::mem::take(&mut out.visible), ..SoupGrad::default() };
    let rows = out
        .vertices
        .chunks_mut(CHUNK)
        .zip(out.opacity.chunks_mut(CHUNK))
        .zip(out.sigma.chunks_mut(CHUNK))
        .zip(out.sh.chunks_mut(CHUNK * k).zip(out.error.chunks_mut(CHUNK)));
    let results: Vec<(Vec<u32>, usize)> =
        parallel::map(rows, |c, (((vertices, opacity), sigma), (sh, error))| {
            let first = c * CHUNK;
            let mut rows =
                GradRows { soup, camera, options, first, vertices, opacity, sigma, sh, error, k };
            for &triangle in stale.visible_in(first..first + CHUNK) {
                rows.zero(triangle as usize);
            }
            rows.fill(pairs, &pairs.chunks[c].projected)
        });
    out.visible = stale.visible;
    out.visible.clear();
    out.dropped = 0;
    for (visible, dropped) in results {
        out.visible.extend(visible);
        out.dropped += dropped;
    }
}

impl GradRows<'_> {
    fn zero(&mut self, triangle: usize) {
        let i = triangle - self.first;
        self.vertices[i] = [Vec3::ZERO; 3];
        self.opacity[i] = 0.0;
        self.sigma[i] = 0.0;
        self.error[i] = 0.0;
        self.sh[i * self.k..(i + 1) * self.k].fill([0.0; 3]);
    }

    /// Writes the rows of the triangles that were drawn; returns them and the number of non-finite
    /// ones.
    fn fill(&mut self, pairs: &PairGrads, projected: &[ProjectedSplat]) -> (Vec<u32>, usize) {
        let Self { soup, camera, options, .. } = *self;
        let mut visible = Vec::with_capacity(projected.len());
        let mut dropped = 0;
        let sums = SplatSums::of_chunk(pairs.tiles, pairs.slots, projected, options.geometry);
        let unclipped = |s: &ProjectedSplat| {
            UnclippedTriangle::new(camera, &soup.vertices[s.record.triangle as usize])
        };
        let corners: Vec<_> =
            projected.iter().map(|s| unclipped(s).piece(&s.piece, options.near)).collect();
        let d_corners =
            dispatch(CornerGrads { corners: &corners, sums: &sums, focal: camera.focal, options });
        let mut at = 0;
        for pieces in projected.chunk_by(|a, b| a.record.triangle == b.record.triangle) {
            let triangle = pieces[0].record.triangle as usize;
            let mut row = GradRow::default();
            let mut drawn = false;
            for (i, piece) in (at..).zip(pieces) {
                if sums[i].is_drawn() {
                    drawn = true;
                    row.add(&sums[i], soup.opacity[triangle]);
                    row.add_corners(
                        &d_corners[i],
                        piece,
                        &soup.vertices[triangle],
                        camera,
                        options.near,
                    );
                }
            }
            at += pieces.len();
            if drawn {
                let rgb = pieces[0].record.rgb;
                visible.push(triangle as u32);
                dropped += usize::from(!self.write(&row, rgb, triangle));
            }
        }
        (visible, dropped)
    }

    /// Writes one row; false, and zeros, when it is not finite.
    fn write(&mut self, row: &GradRow, rgb: [f32; 3], triangle: usize) -> bool {
        // The colour is clamped at 0, which stops a gradient that would lower it further. One that
        // raises it passes, because the optimiser overshoots and the colour could otherwise never
        // return. In linear light the colour is also clamped at 1, as in engines, where all
        // gradients pass for the same reason.
        let d_rgb = std::array::from_fn(|c| match rgb[c] > 0.0 || row.rgb[c] < 0.0 {
            true if self.options.linear => row.rgb[c] * decode(srgb_from_linear(rgb[c])).1,
            true => row.rgb[c],
            false => 0.0,
        });
        let d_offset = self.color_grad(d_rgb, triangle);
        let vertices = row.vertices.map(|v| v + d_offset * (1.0 / 3.0));
        let finite = d_rgb.iter().all(|d| d.is_finite())
            && vertices.iter().all(|v| v.is_finite())
            && row.opacity.is_finite()
            && row.sigma.is_finite();
        if !finite {
            self.zero(triangle);
            return false;
        }
        let i = triangle - self.first;
        self.vertices[i] = vertices;
        self.opacity[i] = row.opacity;
        self.sigma[i] = row.sigma;
        self.error[i] = row.error;
        true
    }

    /// Writes the gradients of the coefficients; returns ∂L/∂(centroid - camera).
    fn color_grad(&mut self, d: [f32; 3], triangle: usize) -> Vec3 {
        let soup = self.soup;
        let i = triangle - self.first;
        let out = &mut self.sh[i * self.k..(i + 1) * self.k];
        let used = soup.active_sh(triangle);
        let degree = soup.active_degree.min(soup.sh_degree);
        let (unit, length) = direction(self.camera, &soup.vertices[triangle]);
        let basis = sh::basis(degree, unit);
        let mut d_basis = [0.0f32; sh::MAX_COEFFICIENTS];
        for (i, coefficient) in used.iter().enumerate() {
            out[i] = d.map(|d| d * basis[i]);
            d_basis[i] = coefficient[0] * d[0] + coefficient[1] * d[1] + coefficient[2] * d[2];
        }
        out[used.len()..].fill([0.0; 3]);
        if degree == 0 || !(length > 0.0) {
            return Vec3::ZERO;
        }
        let d_unit = sh::basis_grad(degree, unit, &d_basis);
        vec3(sh::normalize_grad(unit, length, d_unit))
    }
}

/// Gradient of one triangle without the SH.
#[derive(Default)]
struct GradRow {
    vertices: [Vec3; 3],
    opacity: f32,
    sigma: f32,
    rgb: [f32; 3],
    error: f32,
}

impl GradRow {
    /// Adds the gradients without geometry. A sum is ∂L/∂log(effective opacity), so ∂L/∂log of each
    /// of its factors.
    fn add(&mut self, sums: &SplatSums, opacity: f32) {
        for c in 0..3 {
            self.rgb[c] += sums.base[RGB + c];
        }
        self.opacity += sums.base[OPACITY] / opacity;
        self.sigma += sums.base[SIGMA];
        self.error += sums.base[ERROR];
    }

    /// Adds to the world vertices the gradient of a piece's corners in camera space.
    fn add_corners(
        &mut self,
        d: &CameraTriangle<f32>,
        projected: &ProjectedSplat,
        triangle: &[Vec3; 3],
        camera: &KernelCamera,
        near: f32,
    ) {
        let back = camera.rotation.transpose();
        let each = [d.first - d.edges[0] - d.edges[1], d.edges[0], d.edges[1]];
        if projected.piece == splat::WHOLE {
            for (vertex, d) in self.vertices.iter_mut().zip(each) {
                *vertex += back * vec3(d);
            }
            return;
        }
        let unclipped = UnclippedTriangle::new(camera, triangle);
        for (corner, d) in projected.piece.iter().zip(each) {
            let from = corner.from as usize;
            let to = corner.to as usize;
            if from == to {
                self.vertices[from] += back * vec3(d);
            } else {
                let (d_from, d_to) =
                    splat::near_point_grad(unclipped.corners[from], unclipped.corners[to], near, d);
                self.vertices[from] += back * vec3(d_from);
                self.vertices[to] += back * vec3(d_to);
            }
        }
    }
}
