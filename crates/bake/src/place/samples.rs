//! Samples around the middle of a scene, for finding surfaces there. Only the centroids of triangles count,
//! because triangles of a trained soup lie at all angles to their surface.

use glam::{DVec3, Vec3};
use trisplat_scene::camera::{self, Camera};
use trisplat_scene::math::median::median;
use trisplat_scene::mesh::Mesh;

/// Most triangles that are sampled.
const MOST: usize = 20_000;
/// Radius of the region around the middle, in median distances of the cameras.
const REACH: f64 = 2.0;
/// Share of the triangles in the region of a scene without cameras.
const MOST_OF_IT: f64 = 0.9;
/// Largest side of a triangle that counts, as a share of the region's radius, so that a few huge triangles
/// are no floor.
const MOST_SIDE: f64 = 0.05;

/// The middle of a scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Region {
    /// The point that the cameras look at, or the median of the triangles.
    pub center: DVec3,
    /// Median distance of the cameras from there; without cameras, half of the distance within which most
    /// triangles lie.
    pub radius: f64,
}

/// A point on a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    /// Where it is.
    pub position: DVec3,
    /// Area of the surface that it represents.
    pub weight: f64,
}

/// A mesh whose last faces may be a backdrop.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Foreground<'a> {
    mesh: &'a Mesh,
    faces: usize,
}

impl<'a> Foreground<'a> {
    /// The faces of `mesh` before its last `backdrop`.
    pub(crate) fn new(mesh: &'a Mesh, backdrop: u32) -> Self {
        Self { mesh, faces: mesh.face_count().saturating_sub(backdrop as usize) }
    }

    /// The vertices of these faces: they come before those of the backdrop.
    pub(crate) fn vertices(&self) -> &'a [Vec3] {
        let corners = 3 * self.faces;
        let end = match self.mesh.indices.get(..corners) {
            Some(indices) => indices.iter().max().map_or(0, |last| *last as usize + 1),
            None => corners,
        };
        &self.mesh.positions[..end.min(self.mesh.positions.len())]
    }
}

/// The middle of a scene; `None` when it has no extent.
pub(crate) fn region(scene: Foreground, cameras: &[Camera]) -> Option<Region> {
    let vertices = scene.vertices();
    let vertices: Vec<Vec3> = vertices.iter().step_by(step(vertices.len())).copied().collect();
    let along = |axis: usize| median(vertices.iter().map(|v| v[axis]).collect(), f32::total_cmp);
    let middle = || Some(Vec3::new(along(0)?, along(1)?, along(2)?));
    let center = camera::focus(cameras.iter()).or_else(middle)?.as_dvec3();
    let radius = match cameras.is_empty() {
        true => {
            let mut away: Vec<f64> = vertices.iter().map(|v| v.as_dvec3().distance(center)).collect();
            away.sort_by(f64::total_cmp);
            away.get((MOST_OF_IT * away.len() as f64) as usize).map(|most| most / REACH)
        }
        false => {
            let away = cameras.iter().map(|c| c.position().as_dvec3().distance(center)).collect();
            median(away, f64::total_cmp)
        }
    };
    let radius = radius.filter(|r| *r > 0.0 && r.is_finite())?;
    Some(Region { center, radius })
}

/// Points of a cloud in the region, evenly chosen.
pub(crate) fn points(points: &[Vec3], region: &Region) -> Vec<Sample> {
    let chosen = points.iter().step_by(step(points.len())).map(|p| p.as_dvec3());
    let near = chosen.filter(|p| p.distance(region.center) < REACH * region.radius);
    near.map(|position| Sample { position, weight: 1.0 }).collect()
}

/// Triangles of a scene in the region, evenly chosen, with their areas up to a limit.
pub(crate) fn faces(scene: Foreground, region: &Region) -> Vec<Sample> {
    let most = (MOST_SIDE * region.radius).powi(2);
    let sample = |face: usize| {
        let [a, b, c] = scene.mesh.corners(face).map(|v| v.as_dvec3());
        let (position, area) = ((a + b + c) / 3.0, (b - a).cross(c - a).length() / 2.0);
        let near = position.distance(region.center) < REACH * region.radius;
        (near && area > 0.0).then(|| Sample { position, weight: area.min(most) })
    };
    (0..scene.faces).step_by(step(scene.faces)).filter_map(sample).collect()
}

/// Heights along `up` of the lowest corners of triangles, evenly chosen, and their areas.
pub(crate) fn lowest_corners(scene: Foreground, up: DVec3) -> Vec<(f64, f64)> {
    let sample = |face: usize| {
        let corners = scene.mesh.corners(face).map(|v| v.as_dvec3());
        let [a, b, c] = corners;
        let height = corners.iter().map(|v| v.dot(up)).fold(f64::INFINITY, f64::min);
        (height, (b - a).cross(c - a).length() / 2.0)
    };
    (0..scene.faces).step_by(step(scene.faces)).map(sample).filter(|face| face.1 > 0.0).collect()
}

fn step(count: usize) -> usize {
    count.div_ceil(MOST).max(1)
}
