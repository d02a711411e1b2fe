//! A frame by the plain definition in double precision: the kernels' formulas, every pixel against every triangle, no
//! tiles, no bounds, no lanes. The window is the soft one, the order that of the triangles' depths.

use glam::{DMat3, DVec3, Vec3};
use trisplat_raster::{
    kernel::clip::{self, Piece},
    kernel::splat::{self, CameraTriangle, Splat},
    kernel::{composite, sh, window},
    soft::SoftOptions,
};
use trisplat_scene::{
    Soup,
    camera::Camera,
    math::vec::{V2, V3},
};

/// Depths that differ by less than this share may be taken in either order by single precision.
const ORDER: f64 = 2e-6;
/// A colour this near to its clamp at 0, and a corner this near to the near plane, relative: the gradient has a kink.
const KINK: f64 = 1e-4;
/// [`ExactFrame::margin`] below which a pixel is not compared.
pub const UNDECIDED: f64 = 2e-4;

/// A camera in double precision, as it is written in single precision.
#[derive(Debug, Clone, Copy)]
pub(super) struct ExactCamera {
    pub(super) rotation: DMat3,
    pub(super) translation: DVec3,
    pub(super) focal: V2<f64>,
    pub(super) center: V2<f64>,
}

impl ExactCamera {
    pub(super) fn new(camera: &Camera) -> Self {
        let (focal, center) = (camera.focal.as_dvec2(), camera.center.as_dvec2());
        Self {
            rotation: camera.rotation.as_dmat3(),
            translation: camera.translation.as_dvec3(),
            focal: V2::new(focal.x, focal.y),
            center: V2::new(center.x, center.y),
        }
    }

    /// Corners in camera space.
    pub(super) fn corners(&self, triangle: &[Vec3; 3]) -> [V3<f64>; 3] {
        triangle.map(|v| v3(self.rotation * v.as_dvec3() + self.translation))
    }

    /// From the camera to a triangle's centroid, world axes.
    pub(super) fn offset(&self, [a, b, c]: &[Vec3; 3]) -> DVec3 {
        let centroid = (a.as_dvec3() + b.as_dvec3() + c.as_dvec3()) / 3.0;
        centroid + self.rotation.transpose() * self.translation
    }
}

pub(super) fn v3(v: DVec3) -> V3<f64> {
    V3::new(v.x, v.y, v.z)
}

pub(super) fn dvec3(v: V3<f64>) -> DVec3 {
    DVec3::new(v.x, v.y, v.z)
}

/// A triangle, or a part of one in front of the near plane.
#[derive(Debug, Clone)]
pub(super) struct ExactSplat {
    pub(super) triangle: usize,
    pub(super) piece: Piece,
    pub(super) corners: CameraTriangle<f64>,
    pub(super) splat: Splat<f64>,
    pub(super) sigma: f64,
    pub(super) rgb: [f64; 3],
    floor: f64,
    log2_opacity: f64,
    depth: f64,
}

/// A splat on a pixel.
#[derive(Debug, Clone, Copy)]
pub(super) struct ExactLayer {
    pub(super) splat: usize,
    /// p - origin, px.
    pub(super) offset: V2<f64>,
    /// The nearest edge.
    pub(super) nearest: usize,
    pub(super) ratio: f64,
    pub(super) alpha: f64,
    pub(super) capped: bool,
    /// Transmittance in front of it.
    pub(super) before: f64,
}

/// A frame, and what its gradient needs.
#[derive(Debug, Default)]
pub struct ExactFrame {
    /// Colour, background included. `[height * width]`
    pub rgb: Vec<[f64; 3]>,
    /// Transmittance behind the last layer. `[height * width]`
    pub transmittance: Vec<f64>,
    /// Distance to the nearest jump or kink: of the cutoff in inradii, of others relative; of the order in units of
    /// 1% of a depth. `[height * width]`
    pub margin: Vec<f64>,
    /// Whether the gradient of a triangle has a kink where it is. `[N]`
    pub kinked: Vec<bool>,
    /// The largest sum of magnitudes in a colour, at least 1: what a rounding error of a colour is relative to.
    pub color_scale: f64,
    pub(super) splats: Vec<ExactSplat>,
    pub(super) layers: Vec<ExactLayer>,
    /// First layer of every pixel, and their number. `[height * width + 1]`
    pub(super) starts: Vec<usize>,
}

impl ExactFrame {
    /// Draws a frame.
    pub fn draw(&mut self, soup: &Soup, camera: &Camera, options: &SoftOptions) {
        let exact = ExactCamera::new(camera);
        self.project(soup, &exact, options);
        self.rgb.clear();
        self.transmittance.clear();
        self.margin.clear();
        self.layers.clear();
        self.starts.clear();
        for y in 0..camera.size.y {
            for x in 0..camera.size.x {
                self.starts.push(self.layers.len());
                self.pixel(V2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), soup, options);
            }
        }
        self.starts.push(self.layers.len());
    }

    /// Whether a triangle is seen on any pixel.
    pub fn drawn(&self) -> bool {
        !self.layers.is_empty()
    }

    fn project(&mut self, soup: &Soup, camera: &ExactCamera, options: &SoftOptions) {
        let near = f64::from(options.near);
        self.splats.clear();
        self.kinked.clear();
        self.kinked.resize(soup.len(), false);
        self.color_scale = 1.0;
        for triangle in 0..soup.len() {
            let corners = camera.corners(&soup.vertices[triangle]);
            self.kinked[triangle] = corners.iter().any(|c| (c.z - near).abs() < KINK * near);
            let (pieces, count) = clip::pieces(corners.map(|c| c.z >= near));
            let first = self.splats.len();
            for piece in &pieces[..count] {
                self.splats.extend(exact_splat(soup, triangle, &corners, *piece, camera, options));
            }
            if self.splats.len() > first {
                let (rgb, size, kink) = color(soup, triangle, camera);
                self.splats[first..].iter_mut().for_each(|s| s.rgb = rgb);
                self.color_scale = self.color_scale.max(size);
                self.kinked[triangle] |= kink;
            }
        }
        self.splats.sort_by(|a, b| a.depth.total_cmp(&b.depth));
    }

    fn pixel(&mut self, p: V2<f64>, soup: &Soup, options: &SoftOptions) {
        let (cap, least) = (f64::from(options.alpha_cap), f64::from(options.min_transmittance));
        let (mut t, mut rgb, mut margin) = (1.0, [0.0; 3], f64::INFINITY);
        let mut front: Option<usize> = None;
        for (k, splat) in self.splats.iter().enumerate() {
            let offset = p - splat.splat.origin;
            let ratios = window::ratios(&splat.splat.edge, splat.splat.shift, offset);
            let ratio = window::ratio(&ratios);
            margin = margin.min((ratio - splat.floor).abs());
            if !(ratio >= splat.floor) {
                continue;
            }
            let raw = window::alpha(ratio.log2(), splat.log2_opacity, splat.sigma);
            let mut sorted = ratios;
            sorted.sort_by(f64::total_cmp);
            margin = margin.min((raw / cap - 1.0).abs()).min(sorted[1] - sorted[0]);
            if let Some(front) = front.map(|f| &self.splats[f]) {
                let same = soup.vertices[front.triangle] == soup.vertices[splat.triangle];
                let gap = (splat.depth - front.depth) / splat.depth;
                margin = if same { margin } else { margin.min(gap * (UNDECIDED / ORDER)) };
            }
            front = Some(k);
            let alpha = raw.min(cap);
            let (weight, after) = composite::blend(t, alpha);
            let nearest = (0..3).find(|i| ratios[*i] == ratio).unwrap_or(0);
            let (capped, before) = (raw > cap, t);
            self.layers.push(ExactLayer { splat: k, offset, nearest, ratio, alpha, capped, before });
            (0..3).for_each(|c| rgb[c] += weight * splat.rgb[c]);
            t = after;
            margin = margin.min((t / least - 1.0).abs());
            if t < least {
                break;
            }
        }
        (0..3).for_each(|c| rgb[c] += t * f64::from(options.background[c]));
        self.rgb.push(rgb);
        self.transmittance.push(t);
        self.margin.push(margin);
    }
}

/// The splat of a piece, without its colour; `None` when it is not drawn.
fn exact_splat(
    soup: &Soup,
    triangle: usize,
    whole: &[V3<f64>; 3],
    piece: Piece,
    camera: &ExactCamera,
    options: &SoftOptions,
) -> Option<ExactSplat> {
    let near = f64::from(options.near);
    let [a, b, c] = piece.map(|corner| {
        let (from, to) = (whole[corner.from as usize], whole[corner.to as usize]);
        if corner.from == corner.to { from } else { clip::near_point(from, to, near) }
    });
    let corners = CameraTriangle { first: a, edges: [b - a, c - a] };
    let splat = splat::splat(&corners, camera.focal, camera.center);
    let edges = splat.edge.iter().map(|e| e.x.abs() + e.y.abs()).sum::<f64>();
    if !(splat.inradius > 0.0 && (edges + splat.shift + splat.inradius).is_finite()) {
        return None;
    }
    let (cutoff, sigma) = (f64::from(options.cutoff), f64::from(soup.sigma[triangle]));
    let opacity = f64::from(soup.opacity[triangle]) * splat::fade(splat.inradius, f64::from(options.fade_px));
    if !(opacity > cutoff) {
        return None;
    }
    let floor = window::ratio_floor(opacity.log2(), sigma, cutoff.log2());
    let depth = (a.z + b.z + c.z) / 3.0;
    let (log2_opacity, rgb) = (opacity.log2(), [0.0; 3]);
    Some(ExactSplat { triangle, piece, corners, splat, sigma, rgb, floor, log2_opacity, depth })
}

/// Colour of a triangle, the largest sum of magnitudes in it, and whether it is at its clamp.
fn color(soup: &Soup, triangle: usize, camera: &ExactCamera) -> ([f64; 3], f64, bool) {
    let k = soup.sh_count();
    let unit = camera.offset(&soup.vertices[triangle]).normalize();
    let basis = sh::basis(soup.sh_degree, v3(unit));
    let (mut rgb, mut size) = ([0.5f64; 3], [0.5f64; 3]);
    for (weight, coefficient) in basis.iter().zip(&soup.sh[triangle * k..(triangle + 1) * k]) {
        for c in 0..3 {
            let term = weight * f64::from(coefficient[c]);
            rgb[c] += term;
            size[c] += term.abs();
        }
    }
    let kink = (0..3).any(|c| rgb[c].abs() < KINK * size[c]);
    (rgb.map(|c| c.max(0.0)), size.into_iter().fold(0.0, f64::max), kink)
}
