//! A case of the benchmark, its camera, and the clock.

use glam::{Mat3, UVec2, Vec2, Vec3};
use std::time::Instant;
use trisplat_scene::camera::Camera;
use trisplat_scene::process::cpu_secs;

/// What a case costs: least wall time and least CPU time of a frame, ms; least wall time of every part, ms.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct CaseCost {
    pub(super) wall_ms: f64,
    pub(super) cpu_ms: f64,
    pub(super) parts: Vec<(&'static str, f64)>,
}

/// What is drawn, and by how many threads.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RasterCase {
    pub(super) solid: bool,
    pub(super) threads: usize,
    pub(super) triangles: usize,
    pub(super) size: UVec2,
}

/// A camera at the origin, focal length 0.9 times the width.
pub(super) fn camera(size: UVec2) -> Camera {
    Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(0.9 * size.x as f32),
        center: size.as_vec2() / 2.0,
        size,
    }
}

/// The least cost of `frames` calls of `frame`, which returns the wall time of its parts; one more call comes before
/// to warm up.
pub(super) fn time(frames: usize, mut frame: impl FnMut() -> Vec<(&'static str, f64)>) -> CaseCost {
    let mut cost = CaseCost { wall_ms: f64::INFINITY, cpu_ms: f64::INFINITY, parts: frame() };
    for _ in 0..frames {
        let (clock, before) = (Instant::now(), cpu_secs());
        let parts = frame();
        cost.wall_ms = cost.wall_ms.min(clock.elapsed().as_secs_f64() * 1e3);
        cost.cpu_ms = cost.cpu_ms.min((cpu_secs() - before) * 1e3);
        for (least, now) in cost.parts.iter_mut().zip(parts) {
            least.1 = least.1.min(now.1);
        }
    }
    cost
}
