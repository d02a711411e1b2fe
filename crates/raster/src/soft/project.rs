//! Projects triangles to splats, sixteen at once, and orders them front to back.

use super::frame::{SoftOptions, Sort, SoupRef, Window};
use super::splats;
use super::splats::{
    CHUNK, DepthKey, KernelCamera, ProjectedSplat, Projection, ScreenBox, SplatChunk, SplatRecord,
    UnclippedTriangle, direction,
};
use crate::kernel::clip::Piece;
use crate::kernel::splat::{CameraTriangle, DepthPlane, Splat};
use crate::kernel::{clip, sh, splat, window};
use std::ops::Range;
use trisplat_scene::{
    camera::Camera, math::color::linear_from_srgb, math::lanes::LANES, math::lanes::Lanes, math::lanes::Work,
    math::lanes::dispatch, math::real::Mask, math::real::V2, math::real::V3, parallel, parallel::GRAIN,
};

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
        splats::by_depth(&mut self.keys, &mut self.scratch);
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

/// One number of each piece.
type Column = [f32; LANES];

/// Up to sixteen pieces in front of the near plane, in camera space.
#[derive(Default)]
pub(super) struct PieceGroup {
    first: [Column; 3],
    edges: [[Column; 3]; 2],
    opacity: Column,
    sigma: Column,
    triangle: [u32; LANES],
    piece: [Piece; LANES],
    len: usize,
}

/// The splats of a group, number by number; arbitrary where not drawn.
#[derive(Default)]
struct SplatColumns {
    origin: [Column; 2],
    edge: [[Column; 2]; 3],
    shift: Column,
    floor: Column,
    log2_opacity: Column,
    bounds: [Column; 4],
    radius_px: Column,
    depth: Column,
    /// Those that are drawn, one bit each.
    drawn: u16,
}

/// The depth planes of a group.
#[derive(Default)]
struct PlaneColumns {
    inv_depth: Column,
    slope: [Column; 2],
    normal: [Column; 3],
}

impl PieceGroup {
    #[inline(always)]
    pub(super) fn is_full(&self) -> bool {
        self.len == LANES
    }

    /// Adds a piece; the group must not be full.
    #[inline(always)]
    pub(super) fn push(
        &mut self,
        corners: &CameraTriangle<f32>,
        piece: &Piece,
        triangle: u32,
        opacity: f32,
        sigma: f32,
    ) {
        let at = self.len;
        put(&mut self.first, at, corners.first);
        put(&mut self.edges[0], at, corners.edges[0]);
        put(&mut self.edges[1], at, corners.edges[1]);
        (self.opacity[at], self.sigma[at]) = (opacity, sigma);
        (self.triangle[at], self.piece[at]) = (triangle, *piece);
        self.len += 1;
    }

    /// Adds the splats that are drawn, without their colours, and the bits of their depths; empties the group.
    #[inline(always)]
    pub(super) fn project<L: Lanes>(
        &mut self,
        camera: &KernelCamera,
        options: &SoftOptions,
        projected: &mut Vec<ProjectedSplat>,
        depths: &mut Vec<u32>,
    ) {
        let corners = CameraTriangle {
            first: load3::<L>(&self.first),
            edges: [load3(&self.edges[0]), load3(&self.edges[1])],
        };
        let splats = self.splats::<L>(&corners, camera, options);
        let needs_plane = options.geometry || options.sort == Sort::Pixel;
        let planes = if needs_plane { Some(planes::<L>(&corners, camera)) } else { None };
        let mut left = splats.drawn & ((1u32 << self.len) - 1) as u16;
        while left != 0 {
            let lane = left.trailing_zeros() as usize & (LANES - 1);
            left &= left - 1;
            depths.push(splats.depth[lane].to_bits());
            projected.push(ProjectedSplat {
                record: splats.record(lane, self.sigma[lane], self.triangle[lane]),
                bounds: splats.bounds(lane),
                plane: match &planes {
                    Some(planes) => planes.plane(lane),
                    None => NO_PLANE,
                },
                piece: self.piece[lane],
                radius_px: splats.radius_px[lane],
                rank: 0,
            });
        }
        self.len = 0;
    }

    #[inline(always)]
    fn splats<L: Lanes>(
        &self,
        corners: &CameraTriangle<L>,
        camera: &KernelCamera,
        options: &SoftOptions,
    ) -> SplatColumns {
        let splat = splat::splat(corners, broadcast(camera.focal), broadcast(camera.center));
        let mut opacity = L::load(&self.opacity);
        if options.window == Window::Soft {
            opacity = opacity * splat::fade(splat.inradius, L::splat(options.fade_px));
        }
        let (log2_opacity, sigma) = (opacity.log2(), L::load(&self.sigma));
        let log2_cutoff = L::splat(options.cutoff.log2());
        let scale = options.window.scale(splat.inradius);
        // The smallest drawn ratio or coverage, its inset from the edges, and by how much the bounds grow.
        let (floor, inset, grown) = match options.window {
            Window::Soft => {
                let floor = window::ratio_floor(log2_opacity, sigma, log2_cutoff);
                (floor, floor, 0.0)
            }
            Window::Coverage { width_px } => (L::splat(options.cutoff) / opacity, L::splat(0.0), width_px),
        };
        let bounds = bounds(&splat, inset, L::splat(grown));
        let depth = (corners.edges[0].z + corners.edges[1].z).mul_add(L::splat(1.0 / 3.0), corners.first.z);
        let drawn = L::splat(0.0)
            .lt(splat.inradius)
            .and(is_finite(&splat))
            .and(L::splat(options.cutoff).lt(opacity))
            .and(floor.lt(L::splat(1.0)))
            .and(is_inside(&bounds, camera.size));
        let mut out = SplatColumns::store(&splat, &bounds, scale);
        floor.store(&mut out.floor);
        log2_opacity.store(&mut out.log2_opacity);
        depth.store(&mut out.depth);
        out.drawn = L::bits(drawn);
        out
    }
}

impl SplatColumns {
    /// Values of the splat alone; `scale` is that of its distances from edges.
    #[inline(always)]
    fn store<L: Lanes>(splat: &Splat<L>, bounds: &[L; 4], scale: L) -> Self {
        let mut out = Self::default();
        splat.origin.x.store(&mut out.origin[0]);
        splat.origin.y.store(&mut out.origin[1]);
        for (edge, to) in splat.edge.iter().zip(&mut out.edge) {
            (edge.x * scale).store(&mut to[0]);
            (edge.y * scale).store(&mut to[1]);
        }
        (splat.shift * scale).store(&mut out.shift);
        for (bound, to) in bounds.iter().zip(&mut out.bounds) {
            bound.store(to);
        }
        radius(splat).store(&mut out.radius_px);
        out
    }

    #[inline(always)]
    fn record(&self, lane: usize, sigma: f32, triangle: u32) -> SplatRecord {
        let [a, b, c] = &self.edge;
        SplatRecord {
            origin: [self.origin[0][lane], self.origin[1][lane]],
            edge: [[a[0][lane], a[1][lane]], [b[0][lane], b[1][lane]], [c[0][lane], c[1][lane]]],
            shift: self.shift[lane],
            floor: self.floor[lane],
            sigma,
            log2_opacity: self.log2_opacity[lane],
            rgb: [0.0; 3],
            triangle,
        }
    }

    #[inline(always)]
    fn bounds(&self, lane: usize) -> ScreenBox {
        let [x0, y0, x1, y1] = &self.bounds;
        ScreenBox { lo: [x0[lane], y0[lane]], hi: [x1[lane], y1[lane]] }
    }
}

impl PlaneColumns {
    #[inline(always)]
    fn plane(&self, lane: usize) -> DepthPlane<f32> {
        let Self { inv_depth, slope, normal } = self;
        DepthPlane {
            inv_depth: inv_depth[lane],
            slope: V2::new(slope[0][lane], slope[1][lane]),
            normal: V3::new(normal[0][lane], normal[1][lane], normal[2][lane]),
        }
    }
}

const NO_PLANE: DepthPlane<f32> =
    DepthPlane { inv_depth: 0.0, slope: V2 { x: 0.0, y: 0.0 }, normal: V3 { x: 0.0, y: 0.0, z: 0.0 } };

#[inline(always)]
fn planes<L: Lanes>(corners: &CameraTriangle<L>, camera: &KernelCamera) -> PlaneColumns {
    let plane = splat::depth_plane(corners, broadcast(camera.focal));
    let mut out = PlaneColumns::default();
    plane.inv_depth.store(&mut out.inv_depth);
    plane.slope.x.store(&mut out.slope[0]);
    plane.slope.y.store(&mut out.slope[1]);
    plane.normal.x.store(&mut out.normal[0]);
    plane.normal.y.store(&mut out.normal[1]);
    plane.normal.z.store(&mut out.normal[2]);
    out
}

#[inline(always)]
fn put(columns: &mut [Column; 3], lane: usize, v: V3<f32>) {
    (columns[0][lane], columns[1][lane], columns[2][lane]) = (v.x, v.y, v.z);
}

#[inline(always)]
fn load3<L: Lanes>([x, y, z]: &[Column; 3]) -> V3<L> {
    V3::new(L::load(x), L::load(y), L::load(z))
}

#[inline(always)]
fn broadcast<L: Lanes>(v: V2<f32>) -> V2<L> {
    V2::new(L::splat(v.x), L::splat(v.y))
}

#[inline(always)]
fn is_finite<L: Lanes>(splat: &Splat<L>) -> L::Mask {
    let mut sum = splat.shift + splat.inradius + splat.origin.x.abs() + splat.origin.y.abs();
    for edge in &splat.edge {
        sum = sum + edge.x.abs() + edge.y.abs();
    }
    sum.abs().le(L::splat(f32::MAX))
}

/// Whether a box has pixel centres, which lie in [0.5, size - 0.5]. A NaN passes no comparison.
#[inline(always)]
fn is_inside<L: Lanes>([x0, y0, x1, y1]: &[L; 4], size: [f32; 2]) -> L::Mask {
    let zero = L::splat(0.0);
    let across = zero.lt(*x1).and(x0.lt(L::splat(size[0])));
    across.and(zero.lt(*y1)).and(y0.lt(L::splat(size[1])))
}

/// Left, top, right and bottom of {ratio >= inset}, the triangle shrunk about its incenter by 1 - inset, grown by `grown` px.
#[inline(always)]
fn bounds<L: Lanes>(splat: &Splat<L>, inset: L, grown: L) -> [L; 4] {
    let incenter = splat::incenter(splat);
    let (middle, share) = (splat.origin + incenter, L::splat(1.0) - inset);
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
