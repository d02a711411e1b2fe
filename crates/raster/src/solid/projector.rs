//! Projects world points to samples on a grid, and clips triangles at the near plane and the guard
//! band.

use glam::{DMat3, DVec2, DVec3, UVec2, Vec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lanes::{LANES, Lanes};

/// Units per sample of the grid that corners are snapped to.
pub(super) const GRID: i32 = 256;
/// Half-width of the guard band, samples: triangles that extend farther from the origin are
/// clipped.
pub(super) const GUARD: f32 = 32_768.0;

/// A camera whose pixels are samples.
///
/// Single precision suffices near the picture, because the camera's position is subtracted first,
/// in two parts: a world far from its origin loses nothing.
#[derive(Debug, Clone)]
pub(super) struct Projector {
    /// Width and height, samples.
    pub(super) size: UVec2,
    /// Samples per pixel along each axis.
    pub(super) samples: u32,
    /// Depth of the near plane.
    pub(super) near: f32,
    rotation: DMat3,
    position: DVec3,
    focal: DVec2,
    center: DVec2,
    /// The same in single precision: rows of the rotation, the position in two parts.
    rows: [[f32; 3]; 3],
    high: Vec3,
    low: Vec3,
    focal32: [f32; 2],
    center32: [f32; 2],
}

impl Projector {
    pub(super) fn new(camera: &Camera, samples: u32, near: f32) -> Self {
        let rotation = camera.rotation.as_dmat3();
        let position = -(rotation.inverse() * camera.translation.as_dvec3());
        let high = position.as_vec3();
        let scale = f64::from(samples);
        let focal = camera.focal.as_dvec2() * scale;
        let center = camera.center.as_dvec2() * scale;
        Self {
            size: camera.size * samples,
            samples,
            near,
            rotation,
            position,
            focal,
            center,
            rows: [0, 1, 2].map(|r| camera.rotation.row(r).to_array()),
            high,
            low: (position - high.as_dvec3()).as_vec3(),
            focal32: focal.as_vec2().to_array(),
            center32: center.as_vec2().to_array(),
        }
    }

    /// The vector from the camera to a world point, in world axes.
    #[inline(always)]
    pub(super) fn offset_from_camera(&self, v: Vec3) -> Vec3 {
        (v - self.high) - self.low
    }

    /// A world point in camera space, single precision.
    #[inline(always)]
    pub(super) fn to_camera(&self, v: [f32; 3]) -> [f32; 3] {
        let d = self.offset_from_camera(Vec3::from_array(v)).to_array();
        let row = |r: &[f32; 3]| r[0] * d[0] + r[1] * d[1] + r[2] * d[2];
        [row(&self.rows[0]), row(&self.rows[1]), row(&self.rows[2])]
    }

    /// The projection of a point in camera space, samples, and its 1/z.
    #[inline(always)]
    pub(super) fn project(&self, q: [f32; 3]) -> [f32; 3] {
        let w = 1.0 / q[2];
        let x = q[0] * w * self.focal32[0] + self.center32[0];
        let y = q[1] * w * self.focal32[1] + self.center32[1];
        [x, y, w]
    }

    /// A world point in camera space.
    pub(super) fn to_camera_f64(&self, v: Vec3) -> DVec3 {
        self.rotation * (v.as_dvec3() - self.position)
    }

    /// The projection of a point in camera space, samples.
    pub(super) fn project_f64(&self, q: DVec3) -> DVec2 {
        q.truncate() / q.z * self.focal + self.center
    }

    /// Distance of a point in camera space from one side of the guard band; negative is outside.
    pub(super) fn inside_guard(&self, q: DVec3, side: usize) -> f64 {
        let axis = side % 2;
        let at = q[axis] * self.focal[axis] + self.center[axis] * q.z;
        let guard = 2.0 * f64::from(GUARD) * q.z;
        if side < 2 { at + guard } else { guard - at }
    }

    /// The ray through the centre of a sample, in camera space, z = 1.
    pub(super) fn ray(&self, x: u32, y: u32) -> DVec3 {
        let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        ((at - self.center) / self.focal).extend(1.0)
    }

    /// A ray in world axes, and its change from one sample to the next on the right.
    pub(super) fn ray_to_world(&self, ray: DVec3) -> ([f32; 3], [f32; 3]) {
        let back = self.rotation.transpose();
        let step = back.x_axis / self.focal.x;
        ((back * ray).as_vec3().to_array(), step.as_vec3().to_array())
    }
}

/// The nearest point of the grid.
#[inline(always)]
pub(super) fn snap(at: f32) -> i32 {
    (at * GRID as f32).round_ties_even() as i32
}

/// [`snap`] of sixteen; arbitrary far outside the guard band. Single casts, which check for numbers
/// out of range, took a third of the projection.
#[inline(always)]
pub(super) fn snap_group<L: Lanes>(at: &[f32; LANES], to: &mut [i32; LANES]) {
    (L::load(at) * L::splat(GRID as f32)).store_rounded(to);
}

/// A triangle on the grid: corners and their 1/z.
#[derive(Debug, Clone, Copy)]
pub(super) struct SnappedTriangle {
    pub(super) x: [i32; 3],
    pub(super) y: [i32; 3],
    pub(super) w: [f32; 3],
}

impl SnappedTriangle {
    /// 1/z of the nearest corner, which bounds the triangle.
    #[inline(always)]
    pub(super) fn nearest(&self) -> f32 {
        self.w[0].max(self.w[1]).max(self.w[2])
    }

    /// True when the picture shows the side from which the corners run clockwise: the back.
    #[inline(always)]
    pub(super) fn shows_back(&self) -> bool {
        let across = |i: usize| i64::from(self.x[i] - self.x[0]);
        let down = |i: usize| i64::from(self.y[i] - self.y[0]);
        across(1) * down(2) > across(2) * down(1)
    }
}

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
pub(super) fn clip(
    projector: &Projector,
    corners: [Vec3; 3],
    mut emit: impl FnMut(SnappedTriangle),
) {
    let mut polygon = ClipPolygon::default();
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
    let snapped: Vec<([i32; 2], f32)> =
        polygon.points().iter().map(|p| snap_point(projector, p)).collect();
    for i in 2..snapped.len() {
        let fan = [snapped[0], snapped[i - 1], snapped[i]];
        emit(SnappedTriangle {
            x: fan.map(|p| p.0[0]),
            y: fan.map(|p| p.0[1]),
            w: fan.map(|p| p.1),
        });
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
struct ClipPolygon {
    points: [ClipPoint; MAX_CORNERS],
    count: usize,
}

impl ClipPolygon {
    fn points(&self) -> &[ClipPoint] {
        &self.points[..self.count]
    }

    fn push(&mut self, point: ClipPoint) {
        self.points[self.count] = point;
        self.count += 1;
    }

    /// The part for which `distance` is not negative (Sutherland and Hodgman 1974); `keep` decides
    /// the side of a point.
    fn clip(
        &self,
        distance: impl Fn(&ClipPoint) -> f64,
        keep: impl Fn(&ClipPoint) -> bool,
    ) -> Self {
        let mut out = Self::default();
        for (i, from) in self.points().iter().enumerate() {
            let to = &self.points[(i + 1) % self.count];
            let keeps_from = keep(from);
            let keeps_to = keep(to);
            if keeps_from {
                out.push(*from);
            }
            if keeps_from && !keeps_to {
                out.push(between(from, to, &distance));
            } else if keeps_to && !keeps_from {
                out.push(between(to, from, &distance));
            }
        }
        out
    }
}

/// The point of zero distance between `inside` and `outside`.
fn between(
    inside: &ClipPoint,
    outside: &ClipPoint,
    distance: impl Fn(&ClipPoint) -> f64,
) -> ClipPoint {
    let d_in = distance(inside);
    let d_out = distance(outside);
    let t = (d_in / (d_in - d_out)).clamp(0.0, 1.0);
    ClipPoint {
        camera_space: inside.camera_space + (outside.camera_space - inside.camera_space) * t,
        corner: None,
    }
}
