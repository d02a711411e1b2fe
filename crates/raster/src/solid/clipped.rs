//! Clips a triangle that crosses the near plane or leaves the guard band: rare, so done in double precision.
//!
//! A cut point depends only on the two ends of its edge, from inside to outside. A remaining corner is
//! projected as in unclipped triangles. So neighbours meet without a gap.

use super::bins::SnappedTriangle;
use super::projector::{GRID, Projector, snap};
use glam::{DVec3, Vec3};

/// Planes of the guard band.
const SIDES: usize = 4;
/// Corners of a triangle clipped by five planes.
const MAX_CORNERS: usize = 3 + SIDES + 1;

#[derive(Debug, Clone, Copy, Default)]
struct ClipPoint {
    camera_space: DVec3,
    /// The projection of a corner, as in unclipped triangles.
    corner: Option<[f32; 3]>,
}

/// Passes the pieces of a triangle in front of the near plane and within the guard band to `emit`.
pub(super) fn clip(projector: &Projector, corners: [Vec3; 3], mut emit: impl FnMut(SnappedTriangle)) {
    let mut polygon = Polygon::default();
    for corner in corners {
        let camera_space = projector.to_camera(corner.to_array());
        // The same test as for unclipped triangles must decide here.
        let front = camera_space[2] > projector.near;
        let point = ClipPoint {
            camera_space: projector.to_camera_f64(corner),
            corner: front.then(|| projector.project(camera_space)),
        };
        polygon.push(point);
    }
    let near = f64::from(projector.near);
    polygon = polygon.clip(|p| p.camera_space.z - near, |p| p.corner.is_some());
    for side in 0..SIDES {
        let inside = |p: &ClipPoint| projector.inside_guard(p.camera_space, side);
        polygon = polygon.clip(inside, |p| inside(p) >= 0.0);
    }
    let snapped: Vec<([i32; 2], f32)> = polygon.points().iter().map(|p| snap_point(projector, p)).collect();
    for i in 2..snapped.len() {
        let fan = [snapped[0], snapped[i - 1], snapped[i]];
        emit(SnappedTriangle { x: fan.map(|p| p.0[0]), y: fan.map(|p| p.0[1]), w: fan.map(|p| p.1) });
    }
}

/// A point on the grid, and its 1/z.
fn snap_point(projector: &Projector, point: &ClipPoint) -> ([i32; 2], f32) {
    match point.corner {
        Some([x, y, w]) => ([snap(x), snap(y)], w),
        None => {
            let at = projector.project_f64(point.camera_space) * f64::from(GRID);
            let round = |x: f64| x.round_ties_even() as i32;
            ([round(at.x), round(at.y)], (1.0 / point.camera_space.z) as f32)
        }
    }
}

#[derive(Debug, Clone, Copy, Default)]
struct Polygon {
    points: [ClipPoint; MAX_CORNERS],
    count: usize,
}

impl Polygon {
    fn points(&self) -> &[ClipPoint] {
        &self.points[..self.count]
    }

    fn push(&mut self, point: ClipPoint) {
        self.points[self.count] = point;
        self.count += 1;
    }

    /// The part for which `distance` is not negative (Sutherland and Hodgman 1974); `keep` decides the side
    /// of a point.
    fn clip(&self, distance: impl Fn(&ClipPoint) -> f64, keep: impl Fn(&ClipPoint) -> bool) -> Self {
        let mut out = Self::default();
        for (i, from) in self.points().iter().enumerate() {
            let to = &self.points[(i + 1) % self.count];
            if keep(from) {
                out.push(*from);
            }
            match (keep(from), keep(to)) {
                (true, false) => out.push(between(from, to, &distance)),
                (false, true) => out.push(between(to, from, &distance)),
                _ => {}
            }
        }
        out
    }
}

/// The point of zero distance between `inside` and `outside`.
fn between(inside: &ClipPoint, outside: &ClipPoint, distance: impl Fn(&ClipPoint) -> f64) -> ClipPoint {
    let (d_in, d_out) = (distance(inside), distance(outside));
    let t = (d_in / (d_in - d_out)).clamp(0.0, 1.0);
    ClipPoint {
        camera_space: inside.camera_space + (outside.camera_space - inside.camera_space) * t,
        corner: None,
    }
}
