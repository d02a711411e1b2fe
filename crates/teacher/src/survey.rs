//! Measures the view of a scene from a place, on a small picture.

use super::thin::Along;
use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_raster::soft::{SoftOptions, SoftRasterizer, SoupRef};
use trisplat_scene::{Soup, camera::Camera};

/// Width and height of the survey's pictures, px.
const SIDE: u32 = 32;
/// Largest soup that is not thinned.
const MOST_TRIANGLES: usize = 20_000;
/// Most triangles whose middles are tested for visibility.
const MOST_MIDDLES: usize = 8000;
/// A triangle is hidden if it is this many times farther than the surface in front of it.
const BEHIND: f32 = 1.1;
/// Least coverage of a pixel with a depth.
const LEAST_COVER: f32 = 0.1;
/// Near plane in units of the scene.
const NEAR: f32 = 0.01;

/// Takes small pictures of a soup whose unit is the scene's.
#[derive(Debug)]
pub(super) struct Survey {
    soup: Soup,
    middles: Vec<Vec3>,
    soft: SoftRasterizer,
}

/// What a camera sees.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct ViewCoverage {
    /// Share of the picture that triangles cover.
    pub(super) covered: f32,
    /// Share of the picture with depths below `clearance`.
    pub(super) crowded: f32,
}

impl Survey {
    /// Of `soup`, which is thinned if it is large.
    pub(super) fn new(mut soup: Soup) -> Self {
        soup.truncate_sh(0);
        let along = Along::of(&soup);
        Self {
            middles: along.middles(MOST_MIDDLES),
            soup: along.thinned(&soup, MOST_TRIANGLES),
            soft: SoftRasterizer::new(),
        }
    }

    /// Middles of some of the triangles, spread over all of them.
    pub(super) fn middles(&self) -> &[Vec3] {
        &self.middles
    }

    /// The [`Self::middles`] that the camera of the last look sees.
    pub(super) fn seen(&self, camera: &Camera) -> Vec<bool> {
        let camera = camera.resized(UVec2::splat(SIDE));
        let frame = self.soft.frame();
        let is_seen = |middle: &Vec3| {
            let q = camera.rotation * *middle + camera.translation;
            if !(q.z > NEAR) {
                return false;
            }
            let pixel = (q.truncate() / q.z * camera.focal + camera.center).floor();
            let side = SIDE as f32;
            if !(pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < side && pixel.y < side) {
                return false;
            }
            let depth = frame.median_depth[(pixel.y * side + pixel.x) as usize];
            depth == 0.0 || q.z < depth * BEHIND
        };
        self.middles.iter().map(is_seen).collect()
    }

    /// The view of `camera`, for any size of its picture; surfaces nearer than `clearance` are obstacles.
    pub(super) fn look(&mut self, camera: &Camera, clearance: f32) -> ViewCoverage {
        let camera = camera.resized(UVec2::splat(SIDE));
        let options = SoftOptions {
            near: NEAR,
            // A thinned triangle of one pixel still counts.
            fade_px: 0.0,
            geometry: true,
            ..SoftOptions::default()
        };
        let frame = self.soft.render(&SoupRef::from(&self.soup), &camera, &options);
        let (mut covered, mut crowded) = (0.0, 0.0);
        for (transmittance, depth) in frame.transmittance.iter().zip(&frame.depth) {
            let cover = 1.0 - transmittance;
            covered += cover;
            if cover > LEAST_COVER && depth / cover < clearance {
                crowded += cover;
            }
        }
        let pixels = frame.transmittance.len() as f32;
        ViewCoverage { covered: covered / pixels, crowded: crowded / pixels }
    }
}

/// A square camera at `eye` that looks at `target`.
pub(super) fn camera(eye: Vec3, target: Vec3, up: Vec3, fov_degrees: f32, side: u32) -> Camera {
    let focal = side as f32 / 2.0 / (fov_degrees.to_radians() / 2.0).tan();
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(focal),
        center: Vec2::splat(side as f32 / 2.0),
        size: UVec2::splat(side),
    };
    lens.looking(eye, target, up)
}

/// One of `count` directions that are spread evenly over the sphere.
pub(super) fn direction(i: usize, count: usize) -> Vec3 {
    const GOLDEN_ANGLE: f32 = 2.399_963;
    let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
    let (sin, cos) = (i as f32 * GOLDEN_ANGLE).sin_cos();
    let radius = (1.0 - y * y).sqrt();
    Vec3::new(radius * cos, y, radius * sin)
}
