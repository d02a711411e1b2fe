//! Triangles of the world to splats on the screen, front to back.

use crate::camera::Camera;
use crate::kernel::clip::{self, Corner, Piece};
use crate::kernel::splat::{self, Corners, Plane, Splat};
use crate::kernel::{sh, window};
use crate::math::color::linear_from_srgb;
use crate::math::vec::{V2, V3};
use crate::raster::soft::{SoftOptions, Sort, SoupRef, Window};
use crate::raster::sort::{self, Key};
use glam::{Mat3, Vec3};
use rayon::prelude::*;

/// Triangles that one task projects; also the unit of the gather.
pub(super) const CHUNK: usize = 1024;

/// What the pixels read of a splat: one cache line. With [`Window::Coverage`] `edge` and `shift` are in widths
/// of its ramp and `floor` is the smallest coverage drawn; else they are in inradii, and the smallest ratio.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(super) struct Record {
    pub(super) origin: [f32; 2],
    pub(super) edge: [[f32; 2]; 3],
    pub(super) shift: f32,
    pub(super) floor: f32,
    pub(super) sigma: f32,
    pub(super) log2_opacity: f32,
    pub(super) rgb: [f32; 3],
    pub(super) triangle: u32,
}

/// Box of the region that is drawn, px.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Bounds {
    pub(super) lo: [f32; 2],
    pub(super) hi: [f32; 2],
}

impl Bounds {
    fn grown(self, by: f32) -> Self {
        Self { lo: self.lo.map(|x| x - by), hi: self.hi.map(|x| x + by) }
    }
}

/// Depth plane and normal of a splat.
pub(super) type Sheet = Plane<f32>;

/// A splat before the sort.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub(super) record: Record,
    pub(super) bounds: Bounds,
    pub(super) sheet: Sheet,
    pub(super) piece: Piece,
    /// Largest distance of a corner from the centroid, px.
    pub(super) radius_px: f32,
    /// Its place after the sort.
    pub(super) place: u32,
}

/// The splats of one chunk of triangles, in the triangles' order.
#[derive(Debug, Default)]
pub(super) struct Chunk {
    pub(super) seen: Vec<Seen>,
    depths: Vec<u32>,
}

/// The splats in depth order, as parallel arrays.
#[derive(Debug, Default)]
pub(super) struct Splats {
    pub(super) records: Vec<Record>,
    pub(super) bounds: Vec<Bounds>,
    pub(super) sheets: Vec<Sheet>,
}

impl Splats {
    pub(super) fn len(&self) -> usize {
        self.records.len()
    }
}

/// All splats of a frame.
#[derive(Debug, Default)]
pub(super) struct Projection {
    pub(super) chunks: Vec<Chunk>,
    pub(super) splats: Splats,
    /// Triangles of the soup.
    pub(super) triangles: usize,
    keys: Vec<Key>,
    scratch: Vec<Key>,
}

/// A camera in the kernels' types.
#[derive(Debug, Clone, Copy)]
pub(super) struct View {
    pub(super) rotation: Mat3,
    pub(super) translation: Vec3,
    pub(super) position: Vec3,
    pub(super) focal: V2<f32>,
    pub(super) center: V2<f32>,
    pub(super) size: [f32; 2],
}

impl View {
    pub(super) fn new(camera: &Camera) -> Self {
        Self {
            rotation: camera.rotation,
            translation: camera.translation,
            position: camera.position(),
            focal: V2::new(camera.focal.x, camera.focal.y),
            center: V2::new(camera.center.x, camera.center.y),
            size: camera.size.as_vec2().to_array(),
        }
    }
}

pub(super) fn v3(v: Vec3) -> V3<f32> {
    V3::new(v.x, v.y, v.z)
}

pub(super) fn vec3(v: V3<f32>) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}

/// A triangle in camera space.
pub(super) struct Placed {
    pub(super) whole: Corners<f32>,
    pub(super) corners: [V3<f32>; 3],
}

impl Placed {
    pub(super) fn new(view: &View, [v0, v1, v2]: &[Vec3; 3]) -> Self {
        let first = v3(view.rotation * *v0 + view.translation);
        let edges = [v3(view.rotation * (*v1 - *v0)), v3(view.rotation * (*v2 - *v0))];
        Self { whole: Corners { first, edges }, corners: [first, first + edges[0], first + edges[1]] }
    }

    fn corner(&self, corner: Corner, near: f32) -> V3<f32> {
        let (from, to) = (self.corners[corner.from as usize], self.corners[corner.to as usize]);
        if corner.from == corner.to { from } else { clip::near_point(from, to, near) }
    }

    /// The corners of a piece.
    pub(super) fn piece(&self, piece: &Piece, near: f32) -> Corners<f32> {
        if *piece == clip::WHOLE {
            return self.whole;
        }
        let [a, b, c] = piece.map(|corner| self.corner(corner, near));
        Corners { first: a, edges: [b - a, c - a] }
    }
}

/// Unit direction from the camera to a triangle's centroid, and the distance.
pub(super) fn direction(view: &View, [v0, v1, v2]: &[Vec3; 3]) -> (V3<f32>, f32) {
    let way = (*v0 - view.position) + ((*v1 - *v0) + (*v2 - *v0)) * (1.0 / 3.0);
    let length = way.length();
    let unit = if length > 0.0 { way / length } else { Vec3::Z };
    (v3(unit), length)
}

/// Colour of a triangle before the clamp at 0.
pub(super) fn raw_color(basis: &[f32; sh::MOST], coefficients: &[[f32; 3]]) -> [f32; 3] {
    let mut rgb = [0.5f32; 3];
    for (weight, coefficient) in basis.iter().zip(coefficients) {
        for channel in 0..3 {
            rgb[channel] += weight * coefficient[channel];
        }
    }
    rgb
}

/// The coefficients of triangle `i` that are in use.
pub(super) fn active_sh<'a>(soup: &SoupRef<'a>, i: usize) -> &'a [[f32; 3]] {
    let k = soup.sh_count();
    let used = (soup.active_degree.min(soup.sh_degree) as usize + 1).pow(2);
    &soup.sh[i * k..i * k + used]
}

impl Projection {
    /// Fills the splats, front to back.
    pub(super) fn project(&mut self, soup: &SoupRef, camera: &Camera, options: &SoftOptions) {
        let view = View::new(camera);
        self.triangles = soup.len();
        self.chunks.resize_with(soup.len().div_ceil(CHUNK), Chunk::default);
        self.chunks.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            chunk.seen.clear();
            chunk.depths.clear();
            for i in c * CHUNK..((c + 1) * CHUNK).min(soup.len()) {
                chunk.see(soup, i, &view, options);
            }
        });
    }

    /// Sorts the splats by depth.
    pub(super) fn order(&mut self) {
        self.keys.clear();
        for (c, chunk) in self.chunks.iter().enumerate() {
            // At most two splats a triangle, so the place in a chunk fits in 11 bits.
            let key = |(i, depth): (usize, &u32)| Key { depth: *depth, place: (c * 2 * CHUNK + i) as u32 };
            self.keys.extend(chunk.depths.iter().enumerate().map(key));
        }
        sort::by_depth(&mut self.keys, &mut self.scratch);
        for (place, key) in self.keys.iter().enumerate() {
            let from = key.place as usize;
            self.chunks[from / (2 * CHUNK)].seen[from % (2 * CHUNK)].place = place as u32;
        }
        let chunks = &self.chunks;
        let seen =
            |key: &Key| &chunks[key.place as usize / (2 * CHUNK)].seen[key.place as usize % (2 * CHUNK)];
        let splats = &mut self.splats;
        self.keys.par_iter().map(|k| seen(k).record).collect_into_vec(&mut splats.records);
        self.keys.par_iter().map(|k| seen(k).bounds).collect_into_vec(&mut splats.bounds);
        self.keys.par_iter().map(|k| seen(k).sheet).collect_into_vec(&mut splats.sheets);
    }
}

impl Chunk {
    /// Adds the splats of triangle `i`.
    fn see(&mut self, soup: &SoupRef, i: usize, view: &View, options: &SoftOptions) {
        if !(soup.opacity[i] > options.cutoff) {
            return;
        }
        let triangle = &soup.vertices[i];
        let placed = Placed::new(view, triangle);
        let (pieces, count) = clip::pieces(placed.corners.map(|v| v.z >= options.near));
        let first = self.seen.len();
        for piece in &pieces[..count] {
            let corners = placed.piece(piece, options.near);
            let seen = shape(&corners, soup.opacity[i], soup.sigma[i], view, options);
            if let Some(mut seen) = seen {
                seen.record.triangle = i as u32;
                seen.piece = *piece;
                let depth = corners.first.z + (corners.edges[0].z + corners.edges[1].z) * (1.0 / 3.0);
                self.depths.push(depth.to_bits());
                self.seen.push(seen);
            }
        }
        if self.seen.len() > first {
            let (unit, _) = direction(view, triangle);
            let basis = sh::basis(soup.active_degree.min(soup.sh_degree), unit);
            let rgb = raw_color(&basis, active_sh(soup, i)).map(|c| c.max(0.0));
            let rgb = if options.linear { rgb.map(linear_from_srgb) } else { rgb };
            self.seen[first..].iter_mut().for_each(|seen| seen.record.rgb = rgb);
        }
    }
}

/// Everything but the colour of a splat; nothing when it is not drawn.
fn shape(
    corners: &Corners<f32>,
    opacity: f32,
    sigma: f32,
    view: &View,
    options: &SoftOptions,
) -> Option<Seen> {
    let splat = splat::splat(corners, view.focal, view.center);
    if !(splat.inradius > 0.0 && is_finite(&splat)) {
        return None;
    }
    let opacity = match options.window {
        Window::Soft => opacity * splat::fade(splat.inradius, options.fade_px),
        Window::Coverage { .. } | Window::Sigmoid => opacity,
    };
    let scale = options.window.scale(splat.inradius);
    if !(opacity > options.cutoff) {
        return None;
    }
    let log2_opacity = opacity.log2();
    let (floor, bounds) = match options.window {
        Window::Soft => {
            let floor = window::ratio_floor(log2_opacity, sigma, options.cutoff.log2());
            (floor, bounds(&splat, floor))
        }
        Window::Coverage { width_px } => (options.cutoff / opacity, bounds(&splat, 0.0).grown(width_px)),
        Window::Sigmoid => {
            let floor = window::sigmoid_floor(log2_opacity, sigma, options.cutoff.log2());
            (floor, bounds(&splat, floor / splat.inradius))
        }
    };
    let most = if options.window == Window::Sigmoid { splat.inradius } else { 1.0 };
    // A NaN passes no comparison; pixel centres lie in [0.5, size - 0.5].
    let outside = |i: usize| !(bounds.hi[i] > 0.0 && bounds.lo[i] < view.size[i]);
    if !(floor < most) || outside(0) || outside(1) {
        return None;
    }
    let wants_sheet = options.geometry || options.sort == Sort::Pixel;
    let sheet = if wants_sheet { splat::plane(corners, view.focal) } else { NO_SHEET };
    let record = Record {
        origin: [splat.origin.x, splat.origin.y],
        edge: splat.edge.map(|e| [scale * e.x, scale * e.y]),
        shift: scale * splat.shift,
        floor,
        sigma,
        log2_opacity,
        rgb: [0.0; 3],
        triangle: 0,
    };
    Some(Seen { record, bounds, sheet, piece: clip::WHOLE, radius_px: radius(&splat), place: 0 })
}

const NO_SHEET: Sheet =
    Plane { inv_depth: 0.0, slope: V2 { x: 0.0, y: 0.0 }, normal: V3 { x: 0.0, y: 0.0, z: 0.0 } };

fn is_finite(splat: &Splat<f32>) -> bool {
    let edges: f32 = splat.edge.iter().map(|e| e.x.abs() + e.y.abs()).sum();
    (edges + splat.shift + splat.inradius + splat.origin.x.abs() + splat.origin.y.abs()).is_finite()
}

/// Box of {ratio >= floor}: the triangle shrunk about its incenter by 1 - floor.
fn bounds(splat: &Splat<f32>, floor: f32) -> Bounds {
    let incenter = splat::incenter(splat);
    let corners = [V2::zero(), splat.sides[0], splat.sides[1]]
        .map(|q| splat.origin + incenter + (q - incenter).scale(1.0 - floor));
    let [a, b, c] = corners;
    Bounds {
        lo: [a.x.min(b.x).min(c.x), a.y.min(b.y).min(c.y)],
        hi: [a.x.max(b.x).max(c.x), a.y.max(b.y).max(c.y)],
    }
}

fn radius(splat: &Splat<f32>) -> f32 {
    let [a, b] = splat.sides;
    let centroid = (a + b).scale(1.0 / 3.0);
    centroid.length().max((a - centroid).length()).max((b - centroid).length())
}
