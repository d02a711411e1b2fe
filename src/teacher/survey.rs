//! What a scene shows from somewhere, measured on a small picture.

use crate::camera::Camera;
use crate::raster::soft::{Importance, Soft, SoftOptions, SoupRef};
use crate::soup::Soup;
use glam::{Mat3, UVec2, Vec2, Vec3};

/// Width and height of the pictures that a scene is surveyed with, px.
const SIDE: u32 = 32;
/// A soup of more triangles is thinned: every k-th is drawn, as large as k.
const MOST_TRIANGLES: usize = 60_000;
/// Most middles of triangles that are looked for in pictures.
const MOST_MIDDLES: usize = 8000;
/// A triangle this many times as far as the surface before it is hidden.
const BEHIND: f32 = 1.1;
/// Near plane in units of the scene.
const NEAR: f32 = 0.01;

/// Takes small pictures of a soup whose unit is the scene's.
#[derive(Debug)]
pub struct Survey {
    soup: Soup,
    soft: Soft,
    importance: Importance,
}

/// What a camera sees, in shares and units of the scene.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Sight {
    /// Share of the picture that triangles cover.
    pub covered: f32,
    /// Share of the picture in which something is nearer than `clearance`.
    pub crowded: f32,
    /// Half of what is seen is nearer than this.
    pub depth: f32,
    /// Radius of the triangles that are seen as a share of the picture's width, geometric mean by what they
    /// contribute: small where the scene was trained to be looked at from.
    pub grain: f32,
}

impl Survey {
    /// Of `soup`, which is thinned if it is large.
    pub fn new(mut soup: Soup) -> Self {
        soup.truncate_sh(0);
        let k = soup.len().div_ceil(MOST_TRIANGLES).max(1);
        if k > 1 {
            soup.retain(|i| i % k == 0);
            let grown = (k as f32).sqrt();
            for corners in &mut soup.vertices {
                let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
                *corners = corners.map(|v| middle + (v - middle) * grown);
            }
        }
        Self { soup, soft: Soft::new(), importance: Importance::default() }
    }

    /// Middles of some of the triangles.
    pub fn middles(&self) -> Vec<Vec3> {
        let step = self.soup.len().div_ceil(MOST_MIDDLES).max(1);
        self.soup.vertices.iter().step_by(step).map(|[a, b, c]| (*a + *b + *c) / 3.0).collect()
    }

    /// Which of `middles` the camera of the last look has in its picture and before it.
    pub fn seen(&self, camera: &Camera, middles: &[Vec3]) -> Vec<bool> {
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
        middles.iter().map(is_seen).collect()
    }

    /// What `camera` sees, whatever the size of its picture; `clearance` is the depth below which something stands in
    /// the way.
    pub fn look(&mut self, camera: &Camera, clearance: f32) -> Sight {
        let camera = camera.resized(UVec2::splat(SIDE));
        let options = SoftOptions {
            near: NEAR,
            // A thinned triangle may be as small as a pixel and still count.
            fade_px: 0.0,
            geometry: true,
            importance: true,
            ..SoftOptions::default()
        };
        let frame = self.soft.render(&SoupRef::from(&self.soup), &camera, &options);
        let pixels = frame.transmittance.len() as f32;
        let (mut covered, mut crowded, mut depths) = (0.0, 0.0, Vec::new());
        for (transmittance, depth) in frame.transmittance.iter().zip(&frame.depth) {
            let cover = 1.0 - transmittance;
            covered += cover;
            if cover > 0.1 {
                let depth = depth / cover;
                crowded += if depth < clearance { cover } else { 0.0 };
                depths.push(depth);
            }
        }
        depths.sort_by(f32::total_cmp);
        self.importance.reset(self.soup.len());
        self.soft.accumulate_importance(&mut self.importance);
        let (mut sum, mut weights) = (0.0f64, 0.0f64);
        for (weight, radius) in self.importance.sum_weight.iter().zip(&self.importance.max_radius_px) {
            if *weight > 0.0 && *radius > 0.0 {
                sum += f64::from(*weight) * f64::from(radius / SIDE as f32).ln();
                weights += f64::from(*weight);
            }
        }
        Sight {
            covered: covered / pixels,
            crowded: crowded / pixels,
            depth: depths.get(depths.len() / 2).copied().unwrap_or(f32::INFINITY),
            grain: (sum / weights.max(1e-9)).exp() as f32,
        }
    }
}

/// A square camera at `eye` that looks at `target`.
pub fn camera(eye: Vec3, target: Vec3, up: Vec3, fov_degrees: f32, side: u32) -> Camera {
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
