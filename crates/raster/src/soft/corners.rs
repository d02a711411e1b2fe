//! The gradients of the corners in camera space from those of the pixels, sixteen splats at once.

use super::options::{SoftOptions, Window};
use super::slots::{GEOMETRY_SUMS, OPACITY, RATIO};
use super::splat_sums::SplatSums;
use crate::kernel::splat::{self, CameraTriangle, DepthPlaneGrad, SplatGrad};
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::math::vec::{V2, V3};

/// Gradient of the corners of every splat; arbitrary for one that was not drawn.
pub(super) fn corner_grads(
    corners: &[CameraTriangle<f32>],
    sums: &[SplatSums],
    focal: V2<f32>,
    options: &SoftOptions,
) -> Vec<CameraTriangle<f32>> {
    let mut out = Vec::with_capacity(corners.len());
    dispatch(CornerGrads { corners, sums, focal, options, out: &mut out });
    out
}

struct CornerGrads<'a> {
    corners: &'a [CameraTriangle<f32>],
    sums: &'a [SplatSums],
    focal: V2<f32>,
    options: &'a SoftOptions,
    out: &'a mut Vec<CameraTriangle<f32>>,
}

/// Number of values of a splat's corners, and of its sums from [`OPACITY`] on.
const CORNER_NUMBERS: usize = 9;
const SUM_NUMBERS: usize = RATIO + 9 - OPACITY;

type LaneColumns<const N: usize> = [[f32; LANES]; N];

impl Work for CornerGrads<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut corners: LaneColumns<CORNER_NUMBERS> = [[0.0; LANES]; CORNER_NUMBERS];
        let mut base: LaneColumns<SUM_NUMBERS> = [[0.0; LANES]; SUM_NUMBERS];
        let mut geometry: LaneColumns<GEOMETRY_SUMS> = [[0.0; LANES]; GEOMETRY_SUMS];
        for (some, sums) in self.corners.chunks(LANES).zip(self.sums.chunks(LANES)) {
            for (lane, (c, s)) in some.iter().zip(sums).enumerate() {
                put(&mut corners, lane, &flat(c));
                put(&mut base, lane, &s.base[OPACITY..OPACITY + SUM_NUMBERS]);
                put(&mut geometry, lane, &s.geometry);
            }
            grads::<L>(&mut corners, &base, &geometry, self.focal, self.options);
            for (lane, _) in some.iter().enumerate() {
                let at = |i: usize| V3::new(corners[i][lane], corners[i + 1][lane], corners[i + 2][lane]);
                self.out.push(CameraTriangle { first: at(0), edges: [at(3), at(6)] });
            }
        }
    }
}

fn flat(c: &CameraTriangle<f32>) -> [f32; CORNER_NUMBERS] {
    let [a, b, d] = [c.first, c.edges[0], c.edges[1]];
    [a.x, a.y, a.z, b.x, b.y, b.z, d.x, d.y, d.z]
}

#[inline(always)]
fn put<const N: usize>(columns: &mut LaneColumns<N>, lane: usize, values: &[f32]) {
    for (column, value) in columns.iter_mut().zip(values) {
        column[lane] = *value;
    }
}

#[inline(always)]
fn v2<L: Lanes>(columns: &[[f32; LANES]], i: usize) -> V2<L> {
    V2::new(L::load(&columns[i]), L::load(&columns[i + 1]))
}

#[inline(always)]
fn v3<L: Lanes>(columns: &[[f32; LANES]], i: usize) -> V3<L> {
    V3::new(L::load(&columns[i]), L::load(&columns[i + 1]), L::load(&columns[i + 2]))
}

/// Replaces the corners by their gradients.
#[inline(always)]
fn grads<L: Lanes>(
    columns: &mut LaneColumns<CORNER_NUMBERS>,
    base: &LaneColumns<SUM_NUMBERS>,
    geometry: &LaneColumns<GEOMETRY_SUMS>,
    focal: V2<f32>,
    options: &SoftOptions,
) {
    let focal = V2::new(L::splat(focal.x), L::splat(focal.y));
    let corners = CameraTriangle { first: v3(columns, 0), edges: [v3(columns, 3), v3(columns, 6)] };
    let splat = splat::splat(&corners, focal, V2::zero());
    let full_px = L::splat(options.fade_px);
    let by_fade = splat::fade_grad(splat.inradius, full_px) / splat::fade(splat.inradius, full_px);
    // Distances from the edges are ratios times an inradius, in which a constant inradius cancels.
    let (scale, by_inradius, by_incenter) = match options.window {
        Window::Soft => (L::splat(1.0), by_fade, L::splat(1.0)),
        Window::Coverage { width_px } => (splat.inradius / L::splat(width_px), L::splat(0.0), L::splat(0.0)),
    };
    let first = RATIO - OPACITY;
    let ratio = |i: usize| L::load(&base[first + 3 * i]) * scale;
    let moment = |i: usize| v2::<L>(base, first + 3 * i + 1).scale(scale);
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
            slope: v2(geometry, 1),
            normal: v3(geometry, 3),
        };
        let more = splat::depth_plane_grad(&corners, focal, &splat, &splat::depth_plane(&corners, focal), &d);
        out.first = out.first + more.first;
        out.edges = [out.edges[0] + more.edges[0], out.edges[1] + more.edges[1]];
    }
    let parts = [out.first, out.edges[0], out.edges[1]];
    for (i, v) in parts.into_iter().enumerate() {
        v.x.store(&mut columns[3 * i]);
        v.y.store(&mut columns[3 * i + 1]);
        v.z.store(&mut columns[3 * i + 2]);
    }
}
