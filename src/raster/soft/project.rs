//! Projects world triangles to splats on the screen, and orders them front to back.

use super::camera_space::{KernelCamera, UnclippedTriangle, direction};
use super::options::{SoftOptions, Sort, Window};
use super::sort::{self, DepthKey};
use super::soup_ref::SoupRef;
use super::splats::{CHUNK, ProjectedSplat, Projection, ScreenBox, SplatChunk, SplatRecord};
use crate::camera::Camera;
use crate::kernel::clip;
use crate::kernel::sh;
use crate::kernel::splat::{self, CameraTriangle, DepthPlane, Splat};
use crate::kernel::window;
use crate::math::color::linear_from_srgb;
use crate::math::vec::{V2, V3};
use rayon::prelude::*;

/// Colour of a triangle before the clamp at 0.
fn raw_color(basis: &[f32; sh::MAX_COEFFICIENTS], coefficients: &[[f32; 3]]) -> [f32; 3] {
    let mut rgb = [0.5f32; 3];
    for (weight, coefficient) in basis.iter().zip(coefficients) {
        for channel in 0..3 {
            rgb[channel] += weight * coefficient[channel];
        }
    }
    rgb
}

impl Projection {
    /// Projects the triangles of a soup, chunk by chunk.
    pub(super) fn project(&mut self, soup: &SoupRef, camera: &Camera, options: &SoftOptions) {
        let camera = KernelCamera::new(camera);
        self.triangles = soup.len();
        self.chunks.resize_with(soup.len().div_ceil(CHUNK), SplatChunk::default);
        self.chunks.par_iter_mut().enumerate().for_each(|(c, chunk)| {
            chunk.projected.clear();
            chunk.depths.clear();
            for i in c * CHUNK..((c + 1) * CHUNK).min(soup.len()) {
                chunk.project(soup, i, &camera, options);
            }
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
        let splats = &mut self.splats;
        self.keys.par_iter().map(|k| projected(k).record).collect_into_vec(&mut splats.records);
        self.keys.par_iter().map(|k| projected(k).bounds).collect_into_vec(&mut splats.bounds);
        self.keys.par_iter().map(|k| projected(k).plane).collect_into_vec(&mut splats.planes);
    }
}

impl SplatChunk {
    /// Adds the splats of triangle `i`.
    fn project(&mut self, soup: &SoupRef, i: usize, camera: &KernelCamera, options: &SoftOptions) {
        if !(soup.opacity[i] > options.cutoff) {
            return;
        }
        let triangle = &soup.vertices[i];
        let unclipped = UnclippedTriangle::new(camera, triangle);
        let (pieces, count) = clip::pieces(unclipped.corners.map(|v| v.z >= options.near));
        let first = self.projected.len();
        for piece in &pieces[..count] {
            let corners = unclipped.piece(piece, options.near);
            let projected = project_piece(&corners, soup.opacity[i], soup.sigma[i], camera, options);
            if let Some(mut projected) = projected {
                projected.record.triangle = i as u32;
                projected.piece = *piece;
                let depth = corners.first.z + (corners.edges[0].z + corners.edges[1].z) * (1.0 / 3.0);
                self.depths.push(depth.to_bits());
                self.projected.push(projected);
            }
        }
        if self.projected.len() > first {
            let (unit, _) = direction(camera, triangle);
            let basis = sh::basis(soup.active_degree.min(soup.sh_degree), unit);
            let rgb = raw_color(&basis, soup.active_sh(i)).map(|c| c.max(0.0));
            let rgb = if options.linear { rgb.map(linear_from_srgb) } else { rgb };
            self.projected[first..].iter_mut().for_each(|projected| projected.record.rgb = rgb);
        }
    }
}

/// The splat of a piece, without its colour; `None` when it is not drawn.
fn project_piece(
    corners: &CameraTriangle<f32>,
    opacity: f32,
    sigma: f32,
    camera: &KernelCamera,
    options: &SoftOptions,
) -> Option<ProjectedSplat> {
    let splat = splat::splat(corners, camera.focal, camera.center);
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
    let outside = |i: usize| !(bounds.hi[i] > 0.0 && bounds.lo[i] < camera.size[i]);
    if !(floor < most) || outside(0) || outside(1) {
        return None;
    }
    let needs_plane = options.geometry || options.sort == Sort::Pixel;
    let plane = if needs_plane { splat::depth_plane(corners, camera.focal) } else { NO_PLANE };
    let record = SplatRecord {
        origin: [splat.origin.x, splat.origin.y],
        edge: splat.edge.map(|e| [scale * e.x, scale * e.y]),
        shift: scale * splat.shift,
        floor,
        sigma,
        log2_opacity,
        rgb: [0.0; 3],
        triangle: 0,
    };
    Some(ProjectedSplat { record, bounds, plane, piece: clip::WHOLE, radius_px: radius(&splat), rank: 0 })
}

const NO_PLANE: DepthPlane<f32> =
    DepthPlane { inv_depth: 0.0, slope: V2 { x: 0.0, y: 0.0 }, normal: V3 { x: 0.0, y: 0.0, z: 0.0 } };

fn is_finite(splat: &Splat<f32>) -> bool {
    let edges: f32 = splat.edge.iter().map(|e| e.x.abs() + e.y.abs()).sum();
    (edges + splat.shift + splat.inradius + splat.origin.x.abs() + splat.origin.y.abs()).is_finite()
}

/// Box of {ratio >= floor}: the triangle shrunk about its incenter by 1 - floor.
fn bounds(splat: &Splat<f32>, floor: f32) -> ScreenBox {
    let incenter = splat::incenter(splat);
    let corners = [V2::zero(), splat.sides[0], splat.sides[1]]
        .map(|q| splat.origin + incenter + (q - incenter).scale(1.0 - floor));
    let [a, b, c] = corners;
    ScreenBox {
        lo: [a.x.min(b.x).min(c.x), a.y.min(b.y).min(c.y)],
        hi: [a.x.max(b.x).max(c.x), a.y.max(b.y).max(c.y)],
    }
}

fn radius(splat: &Splat<f32>) -> f32 {
    let [a, b] = splat.sides;
    let centroid = (a + b).scale(1.0 / 3.0);
    centroid.length().max((a - centroid).length()).max((b - centroid).length())
}
