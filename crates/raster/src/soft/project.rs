//! Projects triangles to splats, sixteen at once, and orders them front to back.

use super::frame::{SoftOptions, Sort, SoupRef, Window};
use super::projected::{
    self, CHUNK, Columns, DepthKey, KernelCamera, ProjectedScene, ProjectedSplat, ScreenBox,
    SplatChunk, SplatRecord, UnclippedTriangle, broadcast, columns, direction, flat, numbers, put,
    triangles,
};
use crate::kernel::splat::{self, CameraTriangle, DepthPlane, Piece, Splat};
use crate::kernel::{sh, window};
use std::ops::Range;
use trisplat_scene::camera::Camera;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::math::real::{Mask, V2, V3};
use trisplat_scene::parallel::{self, GRAIN};

impl ProjectedScene {
    /// Projects the triangles of a soup, chunk by chunk.
    pub(super) fn project(&mut self, soup: &SoupRef, camera: &Camera, options: &SoftOptions) {
        let camera = KernelCamera::new(camera);
        self.triangles = soup.count();
        self.chunks.resize_with(soup.count().div_ceil(CHUNK), SplatChunk::default);
        parallel::for_each(&mut self.chunks, |c, chunk| {
            let triangles = c * CHUNK..((c + 1) * CHUNK).min(soup.count());
            dispatch(ProjectChunk { chunk, triangles, soup, camera: &camera, options });
        });
    }

    /// Fills the splats, front to back.
    pub(super) fn order(&mut self) {
        self.keys.clear();
        for (c, chunk) in self.chunks.iter().enumerate() {
            // At most two splats per triangle, so the index in a chunk fits in 11 bits.
            let key = |(i, depth): (usize, &u32)| DepthKey {
                depth: *depth,
                index: (c * 2 * CHUNK + i) as u32,
            };
            self.keys.extend(chunk.depths.iter().enumerate().map(key));
        }
        projected::by_depth(&mut self.keys, &mut self.scratch);
        for (rank, key) in self.keys.iter().enumerate() {
            let from = key.index as usize;
            self.chunks[from / (2 * CHUNK)].projected[from % (2 * CHUNK)].rank = rank as u32;
        }
        let chunks = &self.chunks;
        let projected = |key: &DepthKey| {
            &chunks[key.index as usize / (2 * CHUNK)].projected[key.index as usize % (2 * CHUNK)]
        };
        let keys = &self.keys;
        let splats = &mut self.splats;
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
        let soup = self.soup;
        let near = self.options.near;
        let mut group = PieceGroup::default();
        for i in self.triangles.clone() {
            if !(soup.opacity[i] > self.options.cutoff) {
                continue;
            }
            let unclipped = UnclippedTriangle::new(self.camera, &soup.vertices[i]);
            let (pieces, count) = splat::pieces(unclipped.corners.map(|v| v.z >= near));
            for piece in &pieces[..count] {
                group.push(
                    &unclipped.piece(piece, near),
                    piece,
                    i as u32,
                    soup.opacity[i],
                    soup.sigma[i],
                );
                if group.len == LANES {
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
                last = (
                    triangle,
                    color(self.soup, triangle as usize, self.camera, self.options.linear),
                );
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

/// Up to sixteen pieces in front of the near plane, in camera space.
#[derive(Default)]
struct PieceGroup {
    corners: Columns<9>,
    opacity: [f32; LANES],
    sigma: [f32; LANES],
    triangle: [u32; LANES],
    piece: [Piece; LANES],
    len: usize,
}

impl PieceGroup {
    /// Adds a piece; the group must not be full.
    #[inline(always)]
    fn push(
        &mut self,
        corners: &CameraTriangle<f32>,
        piece: &Piece,
        triangle: u32,
        opacity: f32,
        sigma: f32,
    ) {
        let at = self.len;
        put(&mut self.corners, at, &flat(corners));
        self.opacity[at] = opacity;
        self.sigma[at] = sigma;
        self.triangle[at] = triangle;
        self.piece[at] = *piece;
        self.len += 1;
    }

    /// Adds the splats that are drawn, without their colours, and the bits of their depths; empties
    /// the group.
    #[inline(always)]
    fn project<L: Lanes>(
        &mut self,
        camera: &KernelCamera,
        options: &SoftOptions,
        projected: &mut Vec<ProjectedSplat>,
        depths: &mut Vec<u32>,
    ) {
        let corners = triangles::<L>(&self.corners);
        let (splats, drawn) = self.splats::<L>(&corners, camera, options);
        let needs_plane = options.geometry || options.sort == Sort::Pixel;
        let planes = if needs_plane { planes::<L>(&corners, camera) } else { [[0.0; LANES]; 6] };
        let mut left = drawn & ((1u32 << self.len) - 1) as u16;
        while left != 0 {
            let lane = left.trailing_zeros() as usize & (LANES - 1);
            left &= left - 1;
            let [
                x,
                y,
                ax,
                ay,
                bx,
                by,
                cx,
                cy,
                shift,
                floor,
                log2_opacity,
                x0,
                y0,
                x1,
                y1,
                radius_px,
                depth,
            ] = numbers(&splats, lane);
            let [inv_depth, slope_x, slope_y, nx, ny, nz] = numbers(&planes, lane);
            let slope = V2::new(slope_x, slope_y);
            let normal = V3::new(nx, ny, nz);
            depths.push(depth.to_bits());
            projected.push(ProjectedSplat {
                record: SplatRecord {
                    origin: [x, y],
                    edge: [[ax, ay], [bx, by], [cx, cy]],
                    shift,
                    floor,
                    sigma: self.sigma[lane],
                    log2_opacity,
                    rgb: [0.0; 3],
                    triangle: self.triangle[lane],
                },
                bounds: ScreenBox { lo: [x0, y0], hi: [x1, y1] },
                plane: DepthPlane { inv_depth, slope, normal },
                piece: self.piece[lane],
                radius_px,
                rank: 0,
            });
        }
        self.len = 0;
    }

    /// The numbers of each splat's record and box, its radius and depth; and those that are drawn,
    /// one bit each.
    #[inline(always)]
    fn splats<L: Lanes>(
        &self,
        corners: &CameraTriangle<L>,
        camera: &KernelCamera,
        options: &SoftOptions,
    ) -> (Columns<17>, u16) {
        let splat = splat::splat(corners, broadcast(camera.focal), broadcast(camera.center));
        let mut opacity = L::load(&self.opacity);
        if options.window == Window::Soft {
            opacity = opacity * splat::fade(splat.inradius, L::splat(options.fade_px));
        }
        let log2_opacity = opacity.log2();
        let sigma = L::load(&self.sigma);
        let log2_cutoff = L::splat(options.cutoff.log2());
        // The smallest drawn ratio or coverage, its inset from the edges, by how much the bounds
        // grow, and the unit of distances from edges.
        let (floor, inset, grown, scale) = match options.window {
            Window::Soft => {
                let floor = window::ratio_floor(log2_opacity, sigma, log2_cutoff);
                (floor, floor, 0.0, L::splat(1.0))
            }
            Window::Coverage { width_px } => {
                let floor = L::splat(options.cutoff) / opacity;
                (floor, L::splat(0.0), width_px, splat.inradius / L::splat(width_px))
            }
        };
        let bounds = bounds(&splat, inset, L::splat(grown));
        let depth =
            (corners.edges[0].z + corners.edges[1].z).mul_add(L::splat(1.0 / 3.0), corners.first.z);
        let drawn = L::splat(0.0)
            .lt(splat.inradius)
            .and(is_finite(&splat))
            .and(L::splat(options.cutoff).lt(opacity))
            .and(floor.lt(L::splat(1.0)))
            .and(is_inside(&bounds, camera.size));
        let Splat { origin, shift, .. } = splat;
        let [a, b, c] =
            [splat.edge[0].scale(scale), splat.edge[1].scale(scale), splat.edge[2].scale(scale)];
        let shift = shift * scale;
        let [x0, y0, x1, y1] = bounds;
        let radius = radius(&splat);
        let all = [
            origin.x,
            origin.y,
            a.x,
            a.y,
            b.x,
            b.y,
            c.x,
            c.y,
            shift,
            floor,
            log2_opacity,
            x0,
            y0,
            x1,
            y1,
            radius,
            depth,
        ];
        (columns(all), L::bits(drawn))
    }
}

/// Each splat's depth plane: 1 / z, its slope, and the normal.
#[inline(always)]
fn planes<L: Lanes>(corners: &CameraTriangle<L>, camera: &KernelCamera) -> Columns<6> {
    let DepthPlane { inv_depth, slope, normal } =
        splat::depth_plane(corners, broadcast(camera.focal));
    columns([inv_depth, slope.x, slope.y, normal.x, normal.y, normal.z])
}

#[inline(always)]
fn is_finite<L: Lanes>(splat: &Splat<L>) -> L::Mask {
    let mut sum = splat.shift + splat.inradius + splat.origin.x.abs() + splat.origin.y.abs();
    for edge in &splat.edge {
        sum = sum + edge.x.abs() + edge.y.abs();
    }
    sum.abs().le(L::splat(f32::MAX))
}

/// True for a box with pixel centres, which lie in [0.5, size - 0.5]. A NaN passes no comparison.
#[inline(always)]
fn is_inside<L: Lanes>([x0, y0, x1, y1]: &[L; 4], size: [f32; 2]) -> L::Mask {
    let zero = L::splat(0.0);
    let across = zero.lt(*x1).and(x0.lt(L::splat(size[0])));
    across.and(zero.lt(*y1)).and(y0.lt(L::splat(size[1])))
}

/// Left, top, right and bottom of {ratio >= inset}, the triangle shrunk about its incenter by 1 -
/// inset, grown by `grown` px.
#[inline(always)]
fn bounds<L: Lanes>(splat: &Splat<L>, inset: L, grown: L) -> [L; 4] {
    let incenter = splat::incenter(splat);
    let middle = splat.origin + incenter;
    let share = L::splat(1.0) - inset;
    let a = middle + (-incenter).scale(share);
    let b = middle + (splat.sides[0] - incenter).scale(share);
    let c = middle + (splat.sides[1] - incenter).scale(share);
    [
        a.x.min(b.x).min(c.x) - grown,
        a.y.min(b.y).min(c.y) - grown,
        a.x.max(b.x).max(c.x) + grown,
        a.y.max(b.y).max(c.y) + grown,
    ]
}

/// Largest distance of a corner from the centroid, px.
#[inline(always)]
fn radius<L: Lanes>(splat: &Splat<L>) -> L {
    let [a, b] = splat.sides;
    let centroid = (a + b).scale(L::splat(1.0 / 3.0));
    centroid.length().max((a - centroid).length()).max((b - centroid).length())
}
