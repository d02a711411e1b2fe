//! The height of the ground.

use glam::{DVec3, Vec3};
use trisplat_scene::camera::{self, Camera};
use trisplat_scene::math::geometry::central;
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::Mesh;

/// Thickness of a layer as a share of the region's radius.
const LAYER: f64 = 0.02;
/// The ground is the lowest layer with at least this share of the largest layer's area. A floor
/// beside a larger table counts, stray triangles below it do not.
const MIN_SHARE_OF_LARGEST: f64 = 0.25;
/// Maximum share of a subject's area below its support: a few triangles are astray.
const MAX_AREA_BELOW: f64 = 0.02;
/// A floor is above its lower end by less than this share of its height.
const MAX_HEIGHT_ABOVE_FLOOR: f64 = 0.05;

/// The height along `up` of a scene's floor, its lowest large layer of triangles. `None` for a
/// scene without extent.
pub(crate) fn ground(scene: Foreground, cameras: &[Camera], up: DVec3) -> Option<f64> {
    let region = region(scene, cameras)?;
    let faces = faces(scene, &region);
    let mut heights: Vec<(f64, f64)> =
        faces.iter().map(|f| (f.position.dot(up), f.weight)).collect();
    heights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let layers = layers(&heights, LAYER * region.radius);
    let largest = layers.iter().map(|layer| layer.area).fold(0.0, f64::max);
    // The first large enough layer begins below the floor; the floor is the largest layer near it.
    let first = layers.iter().position(|layer| layer.area >= MIN_SHARE_OF_LARGEST * largest)?;
    let end = layers[first].height + 2.0 * LAYER * region.radius;
    let near = layers[first..].iter().take_while(|layer| layer.height <= end);
    near.max_by(|a, b| a.area.total_cmp(&b.area)).map(|layer| layer.height)
}

/// The height along `up` of a subject's support: the floor that `ground` found, unless the
/// subject reaches far below. Where its support was not kept, the lowest large layer may be its
/// top. `None` for a scene without extent.
pub(crate) fn under(scene: Foreground, ground: Option<f64>, up: DVec3) -> Option<f64> {
    let mut heights = lowest_corners(scene, up);
    heights.sort_by(|a, b| a.0.total_cmp(&b.0));
    let first = heights.first()?.0;
    let last = heights.last()?.0;
    let mut left = MAX_AREA_BELOW * heights.iter().map(|one| one.1).sum::<f64>();
    let lowest = heights.iter().find_map(|(height, area)| {
        left -= area;
        (left <= 0.0).then_some(*height)
    })?;
    let near = ground.filter(|ground| ground - lowest < MAX_HEIGHT_ABOVE_FLOOR * (last - first));
    Some(near.unwrap_or(lowest))
}

/// Area around a height.
struct Layer {
    /// Mean height by area.
    height: f64,
    area: f64,
}

/// The layer of `thickness` that begins at each of the heights, which are sorted. `[heights]`
fn layers(heights: &[(f64, f64)], thickness: f64) -> Vec<Layer> {
    let mut end = 0;
    let mut area = 0.0;
    let mut moment = 0.0;
    let mut layers = Vec::with_capacity(heights.len());
    for (first, weight) in heights {
        while end < heights.len() && heights[end].0 <= first + thickness {
            area += heights[end].1;
            moment += heights[end].0 * heights[end].1;
            end += 1;
        }
        layers.push(Layer { height: if area > 0.0 { moment / area } else { *first }, area });
        area -= weight;
        moment -= first * weight;
    }
    layers
}

// ---- Samples around the middle of a scene, for finding surfaces there ---------------------------

/// Maximum number of triangles that are sampled.
const MAX_SAMPLES: usize = 20_000;
/// Radius of the region around the middle, in median distances of the cameras.
const REACH: f64 = 2.0;
/// Share of the triangles in the region of a scene without cameras.
const REGION_SHARE: f64 = 0.9;
/// Largest side of a triangle that counts, as a share of the region's radius, so that a few huge
/// triangles are no floor.
const MAX_SIDE: f64 = 0.05;

/// The middle of a scene.
#[derive(Debug, Clone, Copy)]
pub(crate) struct GroundRegion {
    /// The point that the cameras look at, or the median of the triangles.
    pub center: DVec3,
    /// Median distance of the cameras from there; without cameras, half of the distance within
    /// which most triangles lie.
    pub radius: f64,
}

/// A point on a surface.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SurfaceSample {
    /// World position.
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
pub(crate) fn region(scene: Foreground, cameras: &[Camera]) -> Option<GroundRegion> {
    let vertices = scene.vertices();
    let vertices: Vec<Vec3> = vertices.iter().step_by(step(vertices.len())).copied().collect();
    let center = camera::focus(cameras.iter()).or_else(|| central(&vertices))?.as_dvec3();
    let radius = if cameras.is_empty() {
        let mut away: Vec<f64> = vertices.iter().map(|v| v.as_dvec3().distance(center)).collect();
        away.sort_by(f64::total_cmp);
        away.get((REGION_SHARE * away.len() as f64) as usize).map(|most| most / REACH)
    } else {
        let away = cameras.iter().map(|c| c.position().as_dvec3().distance(center)).collect();
        median(away, f64::total_cmp)
    };
    let radius = radius.filter(|r| *r > 0.0 && r.is_finite())?;
    Some(GroundRegion { center, radius })
}

/// Points of a cloud in the region, evenly chosen.
pub(crate) fn points(points: &[Vec3], region: &GroundRegion) -> Vec<SurfaceSample> {
    let chosen = points.iter().step_by(step(points.len())).map(|p| p.as_dvec3());
    let near = chosen.filter(|p| p.distance(region.center) < REACH * region.radius);
    near.map(|position| SurfaceSample { position, weight: 1.0 }).collect()
}

/// Triangles of a scene in the region, evenly chosen, with their areas up to a limit.
pub(crate) fn faces(scene: Foreground, region: &GroundRegion) -> Vec<SurfaceSample> {
    let max_side_squared = (MAX_SIDE * region.radius).powi(2);
    let sample = |face: usize| {
        let [a, b, c] = scene.mesh.corners(face).map(|v| v.as_dvec3());
        let position = (a + b + c) / 3.0;
        let area = (b - a).cross(c - a).length() / 2.0;
        let near = position.distance(region.center) < REACH * region.radius;
        (near && area > 0.0).then(|| SurfaceSample { position, weight: area.min(max_side_squared) })
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
    count.div_ceil(MAX_SAMPLES).max(1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use trisplat_scene::Rng;
    use trisplat_scene::mesh::{Colors, Mesh};

    /// Level squares of `side` at a height, in small triangles.
    fn level(mesh: &mut Mesh, height: f32, side: f32, count: u64) {
        let rng = Rng::new(height.to_bits().into(), "level", 0);
        for i in 0..count {
            let at = |k: u64| rng.uniform(4 * i + k);
            let corner =
                Vec3::new(side * (at(0) - 0.5), height + 0.002 * at(2), side * (at(1) - 0.5));
            mesh.positions.extend([corner, corner + Vec3::X * 0.05, corner + Vec3::Z * 0.05]);
        }
        mesh.colors = Colors::Face(vec![[0.5; 3]; mesh.face_count()]);
    }

    #[test]
    fn the_floor_is_found_below_a_larger_table() {
        let mut mesh = Mesh::default();
        level(&mut mesh, 0.8, 1.0, 3000);
        level(&mut mesh, -0.5, 3.0, 2400);
        level(&mut mesh, -2.0, 0.2, 20);
        let found = ground(Foreground::new(&mesh, 0), &[], DVec3::Y).expect("a floor");
        assert!((found + 0.5).abs() < 0.01, "{found}");
        let found = ground(Foreground::new(&mesh, 0), &[], DVec3::NEG_Y)
            .expect("the other way around the table is the lowest");
        assert!((found + 0.8).abs() < 0.01, "{found}");
    }

    #[test]
    fn without_a_floor_it_is_where_the_triangles_end() {
        let rng = Rng::new(3, "ball", 0);
        let at = |i: u64| Vec3::from([0, 1, 2].map(|k| rng.normal(3 * i + k))).normalize();
        let upright = |i: u64| [at(i), at(i) + Vec3::Y * 0.02, at(i) + Vec3::new(0.002, 0.01, 0.0)];
        let positions: Vec<Vec3> = (0..5000).flat_map(upright).collect();
        let colors = Colors::Face(vec![[0.5; 3]; 5000]);
        let found = ground(
            Foreground::new(&Mesh { positions, colors, ..Mesh::default() }, 0),
            &[],
            DVec3::Y,
        )
        .expect("an end");
        assert!((-1.0..-0.93).contains(&found), "{found}");
        assert_eq!(ground(Foreground::new(&Mesh::default(), 0), &[], DVec3::Y), None);
    }
}
