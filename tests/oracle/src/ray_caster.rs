//! What the solid rasteriser may draw, by casting a ray through every sample in double precision.
//!
//! The two may differ only in a band that is stated here: corners are snapped to 1/256 of a sample,
//! so a face is undecided within [`FaceAt::band`] of its edges, and so is the order of two faces
//! whose 1/z differ by less than what that distance makes of them, and of the rounding of their
//! corners' depths: those are sums of products of coordinates as large as the corners are far away,
//! so the corners of a long sliver have less exact depths than its middle.

use glam::{DVec2, DVec3, Vec3};
use trisplat_raster::solid::{NO_FACE, Visibility};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;

/// Snapping, in samples: half of 1/256 along both axes, and as much again for rounding.
const SNAP: f64 = 1.0 / 256.0;
/// Rounding of the projection in single precision, relative to the distance from the principal
/// point.
const ROUNDING: f64 = 1e-6;
/// Rounding of a corner's depth in single precision, relative to its distance from the camera: that
/// of a difference, three products and their sum.
const DEPTH_ROUNDING: f64 = 4e-7;
/// Where corners are clipped in any case, samples: the guard band.
const GUARD: f64 = 65_536.0;

/// A face, ready for any ray.
#[derive(Debug, Clone)]
pub struct RayFace {
    normals: [DVec3; 3],
    sum: DVec3,
    volume: f64,
    /// Samples per unit of each normal's product with a ray, inverse.
    steep: [f64; 3],
    steep_sum: f64,
    band: f64,
    /// Rounding of 1/z at the corners.
    corners: f64,
    near: f64,
}

/// A face at a sample.
#[derive(Debug, Clone, Copy)]
pub struct FaceAt {
    /// Distance to each edge's line, samples, positive inside.
    pub inside: [f64; 3],
    /// Distance by which edges may have been moved, samples.
    pub band: f64,
    /// 1/z of the face's plane.
    pub w: f64,
    /// Tolerance of `w`.
    pub slack: f64,
    /// Perspective-correct weights of the corners.
    pub weights: [f64; 3],
}

/// The ray through a sample of a picture with `samples` per pixel along each axis, in camera space.
pub fn ray(camera: &Camera, samples: u32, x: u32, y: u32) -> DVec3 {
    let scale = f64::from(samples);
    let focal = camera.focal.as_dvec2() * scale;
    let center = camera.center.as_dvec2() * scale;
    ((DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - center) / focal).extend(1.0)
}

impl RayFace {
    /// A face of these corners in the world.
    pub fn new(camera: &Camera, samples: u32, near: f64, corners: [Vec3; 3]) -> Self {
        let rotation = camera.rotation.as_dmat3();
        let position = -(rotation.inverse() * camera.translation.as_dvec3());
        let focal = camera.focal.as_dvec2() * f64::from(samples);
        let q = corners.map(|v| rotation * (v.as_dvec3() - position));
        let normals = [q[1].cross(q[2]), q[2].cross(q[0]), q[0].cross(q[1])];
        let steep = |n: DVec3| (n.truncate() / focal).length();
        let sum: DVec3 = normals.iter().sum();
        let reach = |q: &DVec3| (q.truncate() / q.z * focal).length().min(GUARD);
        // Corners that are not before the camera are clipped in double precision.
        let corner = |q: &DVec3| q.length() / (q.z * q.z);
        let corners = q.iter().filter(|q| q.z > near).map(corner).fold(0.0, f64::max);
        let farthest =
            q.iter().filter(|q| q.z > near).map(reach).fold(focal.max_element(), f64::max);
        Self {
            normals,
            sum,
            volume: q[0].dot(normals[0]),
            steep: normals.map(steep),
            steep_sum: steep(sum),
            band: SNAP + ROUNDING * farthest,
            corners: DEPTH_ROUNDING * corners,
            near,
        }
    }

    /// The face where a ray meets its plane; `None` where it covers nothing anywhere near.
    pub fn at(&self, ray: DVec3) -> Option<FaceAt> {
        let along = self.sum.dot(ray);
        let w = along / self.volume;
        let slack = self.steep_sum / self.volume.abs() * self.band + 1e-6 * w.abs() + self.corners;
        let parts = self.normals.map(|n| n.dot(ray));
        let inside = std::array::from_fn(|i| along.signum() * parts[i] / self.steep[i]);
        let out = inside.iter().any(|d: &f64| *d < -self.band)
            || w < -slack
            || w - slack > 1.0 / self.near;
        let weights = parts.map(|part| part / along);
        (!out).then_some(FaceAt { inside, band: self.band, w, slack, weights })
    }
}

impl FaceAt {
    /// Whether the sample lies on the face.
    pub fn covers(&self) -> bool {
        self.inside.iter().all(|d| *d >= 0.0) && self.w > 0.0
    }

    /// Whether it does wherever the corners are snapped to.
    pub fn certainly_covers(&self, near: f64) -> bool {
        self.inside.iter().all(|d| *d > self.band)
            && self.w > self.slack
            && self.w + self.slack < 1.0 / near
    }
}

/// Samples of a picture with one per pixel on which a face is shown that cannot be, or a face is
/// missed that must hide what is shown.
pub fn wrong_samples(drawn: &Visibility, mesh: &Mesh, camera: &Camera, near: f64) -> usize {
    let faces: Vec<RayFace> =
        (0..mesh.face_count()).map(|f| RayFace::new(camera, 1, near, mesh.corners(f))).collect();
    let mut wrong = 0;
    for y in 0..drawn.size.y {
        for x in 0..drawn.size.x {
            let ray = ray(camera, 1, x, y);
            let got = drawn.face[(y * drawn.size.x + x) as usize];
            let mine = faces.get(got as usize).and_then(|face| face.at(ray));
            let limit = mine.map_or(0.0, |mine| mine.w + mine.slack);
            let hidden = |(f, face): (usize, &RayFace)| {
                f as u32 != got
                    && face
                        .at(ray)
                        .is_some_and(|o| o.certainly_covers(near) && o.w - o.slack > limit)
            };
            let impossible = got != NO_FACE && mine.is_none();
            wrong += usize::from(impossible || faces.iter().enumerate().any(hidden));
        }
    }
    wrong
}
