//! A scene divided into its content and the far shell that encloses it, such as a sky dome.

use super::viewpoint::{ViewpointInput, viewpoint};
use glam::Vec3;
use std::ops::Range;
use trisplat_scene::camera::{Camera, Viewpoint};
use trisplat_scene::math::geometry::{central, centroid};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Provenance, Scene};

/// A scene, divided at its far shell.
#[derive(Debug)]
pub struct SceneEnclosure<'a> {
    scene: &'a Scene,
    /// Triangles of the content.
    content: Vec<usize>,
    /// Triangles of the far shell.
    shell: Vec<usize>,
}

impl<'a> SceneEnclosure<'a> {
    /// Divides `scene` by flags in its file, or by its shape.
    pub fn of(scene: &'a Scene, provenance: &Provenance) -> Self {
        let count = scene.triangle_count();
        let backdrop = match scene {
            Scene::Mesh(_) => count - (provenance.backdrop_faces as usize).min(count)..count,
            Scene::Soup(_) => count..count,
        };
        let corners = |triangle: usize| scene.corners(triangle);
        let is_flagged = !backdrop.is_empty() || scene.shell_count() > 0;
        let detected = if is_flagged { None } else { far_shell(corners, count) };
        let is_shell = |triangle: &usize| match &detected {
            Some(is_far) => is_far[*triangle],
            None => backdrop.contains(triangle) || scene.is_shell(*triangle),
        };
        let (shell, content) = (0..count).partition::<Vec<usize>, _>(is_shell);
        Self { scene, content, shell }
    }

    /// The first viewpoint, with `up` upwards; one of the photos' `cameras`, if there are any.
    /// `None` without visible triangles.
    pub fn viewpoint(&self, cameras: &[Camera], up: Vec3) -> Option<Viewpoint> {
        let corners = |i: usize| self.scene.corners(self.content[i]);
        let enclosure_distance = |from: Vec3| self.distance_from(from);
        let is_single_sided = |i: usize| self.scene.is_single_sided(self.content[i]);
        let count = self.content.len();
        let input = ViewpointInput {
            corners: &corners,
            is_single_sided: &is_single_sided,
            count,
            is_surface: false,
            cameras,
            up,
            enclosure_distance: &enclosure_distance,
        };
        viewpoint(&input).map(|chosen| chosen.viewpoint)
    }

    /// Distance from a place to the far shell; infinite without one.
    pub fn distance_from(&self, from: Vec3) -> f32 {
        let corners = self.shell.iter().flat_map(|triangle| self.scene.corners(*triangle));
        corners.map(|corner| corner.distance_squared(from)).fold(f32::INFINITY, f32::min).sqrt()
    }

    /// Distance from a place to the far shell along a unit direction; infinite where the scene is
    /// open.
    pub fn distance_along(&self, from: Vec3, direction: Vec3) -> f32 {
        let distance = |triangle: &usize| {
            ray_triangle_distance(self.scene.corners(*triangle), from, direction)
        };
        self.shell.iter().filter_map(distance).fold(f32::INFINITY, f32::min)
    }
}

/// Distance along a ray to a triangle, in lengths of `direction`; both sides of the triangle count.
pub fn ray_triangle_distance([a, b, c]: [Vec3; 3], from: Vec3, direction: Vec3) -> Option<f32> {
    let ab = b - a;
    let ac = c - a;
    let offset = from - a;
    let p = direction.cross(ac);
    let q = offset.cross(ab);
    let determinant = ab.dot(p);
    // For a ray along the triangle's plane these are infinite or NaN.
    let u = offset.dot(p) / determinant;
    let v = direction.dot(q) / determinant;
    let t = ac.dot(q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t > 0.0 && t.is_finite()).then_some(t)
}

/// The mean up direction of the pictures of `cameras`; `fallback` without cameras.
pub fn mean_up(cameras: &[Camera], fallback: Vec3) -> Vec3 {
    let sum = cameras.iter().map(|camera| -camera.rotation.row(1)).sum::<Vec3>();
    sum.try_normalize().unwrap_or(fallback)
}

/// Maximum number of triangles that the gap is measured with.
const MAX_SAMPLES: usize = 50_000;
/// Minimum number of triangles of a scene with a shell.
const MIN_TRIANGLES: usize = 64;
/// Minimum distance of the shell, as a multiple of the median distance of the scene.
const MIN_DISTANCE: f32 = 2.5;
/// The gap before the shell, as a share of its distance.
const GAP: f32 = 0.25;
/// Maximum number of triangles in the gap, as a share of those of the shell.
const MAX_GAP_SHARE: f32 = 0.02;
/// Largest share of the triangles in a shell.
const MAX_SHELL_SHARE: f32 = 0.4;
/// Minimum mean cosine, by area, between the shell's normals and the direction to the middle.
const MIN_FACING_COSINE: f32 = 0.8;
/// Minimum share of all directions that the shell covers.
const MIN_COVERED: f32 = 0.7;
/// Rows and columns of tested directions on each face of a cube.
const GRID: usize = 8;

/// Flags of the `count` triangles, given by their `corners`, that are a far shell; `None` without
/// one. `[N]`
pub fn far_shell(corners: impl Fn(usize) -> [Vec3; 3] + Sync, count: usize) -> Option<Vec<bool>> {
    if count < MIN_TRIANGLES {
        return None;
    }
    let middle = |face: usize| centroid(corners(face));
    let sampled: Vec<Vec3> = (0..count)
        .step_by(count.div_ceil(MAX_SAMPLES))
        .map(middle)
        .filter(|p| p.is_finite())
        .collect();
    let center = central(&sampled)?;
    let mut distances: Vec<f32> = sampled.iter().map(|p| p.distance(center)).collect();
    distances.sort_unstable_by(f32::total_cmp);
    let from = shell_distance(&distances)?;
    let is_far: Vec<bool> =
        parallel::collect(count, GRAIN, |face| middle(face).distance(center) >= from);
    let far: Vec<[Vec3; 3]> = (0..count)
        .filter(|face| is_far[*face])
        .map(|face| corners(face).map(|p| p - center))
        .collect();
    (face_origin(&far) && cover_directions(&far)).then_some(is_far)
}

/// The distance at which the shell begins, from the sorted distances of triangles.
fn shell_distance(distances: &[f32]) -> Option<f32> {
    let half = *distances.get(distances.len() / 2)?;
    let nearest = MIN_DISTANCE * half;
    let first = distances.partition_point(|d| *d < nearest);
    let candidates = (first..distances.len()).filter(|at| {
        let from = distances[*at];
        let shell = distances.len() - at;
        let gap = at - distances.partition_point(|d| *d < (1.0 - GAP) * from);
        from > 0.0
            && shell as f32 <= MAX_SHELL_SHARE * distances.len() as f32
            && gap as f32 <= MAX_GAP_SHARE * shell as f32
    });
    candidates.map(|at| distances[at]).next()
}

/// True if triangles around the origin face it.
fn face_origin(far: &[[Vec3; 3]]) -> bool {
    let mut facing = 0.0f64;
    let mut area = 0.0f64;
    for [a, b, c] in far {
        let normal = (*b - *a).cross(*c - *a);
        facing += f64::from(normal.dot(((*a + *b + *c) / 3.0).normalize_or_zero()).abs());
        area += f64::from(normal.length());
    }
    area > 0.0 && facing >= f64::from(MIN_FACING_COSINE) * area
}

/// True if the triangles cover most directions from the origin.
fn cover_directions(far: &[[Vec3; 3]]) -> bool {
    let directions = directions();
    let min_count = MIN_COVERED * directions.len() as f32;
    let mut covered = vec![false; directions.len()];
    let mut count = 0;
    for triangle in far {
        let cone = Cone::of(triangle);
        let [faces, down, across] = near_directions(triangle);
        for i in faces.flat_map(|face| down.clone().map(move |y| (face * GRID + y) * GRID)) {
            for i in across.clone().map(|x| i + x) {
                if !covered[i] && cone.contains(directions[i]) {
                    covered[i] = true;
                    count += 1;
                }
            }
        }
        if count as f32 >= min_count {
            return true;
        }
    }
    false
}

/// The directions from the origin to a triangle.
struct Cone {
    sides: [Vec3; 3],
    axis: Vec3,
}

impl Cone {
    fn of([a, b, c]: &[Vec3; 3]) -> Self {
        Self { sides: [a.cross(*b), b.cross(*c), c.cross(*a)], axis: *a + *b + *c }
    }

    fn contains(&self, direction: Vec3) -> bool {
        let sides = self.sides.map(|side| side.dot(direction));
        let inside = sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0);
        inside && self.axis.dot(direction) > 0.0
    }
}

/// Directions over the sphere: the middles of the squares of a cube's faces.
fn directions() -> Vec<Vec3> {
    let place = |i: usize| 2.0 * (i as f32 + 0.5) / GRID as f32 - 1.0;
    let of_face = |face: usize| {
        let axis = face / 2;
        let sign = if face.is_multiple_of(2) { 1.0 } else { -1.0 };
        (0..GRID * GRID).map(move |i| {
            let mut direction = Vec3::ZERO;
            direction[axis] = sign;
            direction[(axis + 1) % 3] = place(i % GRID);
            direction[(axis + 2) % 3] = place(i / GRID);
            direction
        })
    };
    (0..6).flat_map(of_face).collect()
}

/// Cube faces, rows and columns of the directions in which a triangle may lie: few where its
/// corners are on one face.
fn near_directions(corners: &[Vec3; 3]) -> [Range<usize>; 3] {
    let face_of =
        |v: &Vec3| 2 * v.abs().max_position() + usize::from(v[v.abs().max_position()] < 0.0);
    let face = face_of(&corners[0]);
    if corners.iter().any(|corner| face_of(corner) != face) {
        return [0..6, 0..GRID, 0..GRID];
    }
    let lines = |axis: usize| {
        let at = corners.map(|v| (v[axis % 3] / v[face / 2].abs() + 1.0) / 2.0 * GRID as f32 - 0.5);
        let low = at[0].min(at[1]).min(at[2]);
        let high = at[0].max(at[1]).max(at[2]);
        low.floor() as usize..(high.ceil() as usize + 1).min(GRID)
    };
    [face..face + 1, lines(face / 2 + 2), lines(face / 2 + 1)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::mesh::{Colors, Mesh};

    #[test]
    fn distance_along_ends_at_the_shell_in_that_direction() {
        // A thing at the origin, a wall two units to the left, half a wall three units ahead.
        let thing = [Vec3::ZERO, Vec3::X * 0.1, Vec3::Y * 0.1];
        let left =
            [Vec3::new(-2.0, -9.0, -9.0), Vec3::new(-2.0, 20.0, -9.0), Vec3::new(-2.0, -9.0, 20.0)];
        let ahead = [Vec3::new(-9.0, 0.5, 3.0), Vec3::new(9.0, 0.5, 3.0), Vec3::new(0.0, 9.0, 3.0)];
        let positions = [thing, left, ahead].concat();
        let mesh = Mesh { positions, colors: Colors::Face(vec![[0.5; 3]; 3]), ..Mesh::default() };
        let provenance = Provenance { backdrop_faces: 2, ..Provenance::default() };
        let scene = Scene::Mesh(mesh);
        let enclosure = SceneEnclosure::of(&scene, &provenance);
        let distance =
            |direction: Vec3| enclosure.distance_along(Vec3::ZERO, direction.normalize());
        assert!((distance(-Vec3::X) - 2.0).abs() < 1e-6 && distance(Vec3::X) == f32::INFINITY);
        assert!((distance(Vec3::new(0.0, 1.0, 1.0)) - 3.0 * 2f32.sqrt()).abs() < 1e-5);
        assert_eq!((distance(Vec3::Z), distance(Vec3::Y)), (f32::INFINITY, f32::INFINITY));
    }
}

#[cfg(test)]
mod far_shell_tests {
    use super::*;
    use trisplat_scene::Rng;
    use trisplat_scene::math::geometry::octasphere;

    /// Small triangles in a ball of this radius.
    fn things(count: u64, radius: f32) -> Vec<[Vec3; 3]> {
        let rng = Rng::new(8, "things", count);
        let point =
            |i: u64| 2.0 * Vec3::from([0, 1, 2].map(|axis| rng.uniform(3 * i + axis))) - 1.0;
        (0..count)
            .map(|i| [0, 1, 2].map(|k| radius * (point(2 * i) + 0.05 * point(2 * i + 1 + k))))
            .collect()
    }

    fn sphere(radius: f32, keep: impl Fn(Vec3) -> bool) -> Vec<[Vec3; 3]> {
        let (corners, faces) = octasphere(3);
        let triangles = faces.iter().map(|face| face.map(|i| radius * corners[i as usize]));
        triangles.filter(|[a, b, c]| keep((*a + *b + *c) / 3.0)).collect()
    }

    fn shell_size(triangles: &[[Vec3; 3]]) -> Option<usize> {
        let is_far = far_shell(|face| triangles[face], triangles.len())?;
        Some(is_far.iter().filter(|far| **far).count())
    }

    #[test]
    fn a_closed_far_shell_of_any_soup_is_recognised() {
        let all = |_| true;
        let with = |shell: Vec<[Vec3; 3]>| [things(4000, 1.0), shell].concat();
        assert_eq!(shell_size(&with(sphere(10.0, all))), Some(512));
        // Triangles that overlap, as trained ones do, and are not quite on it.
        let overlapping = sphere(10.0, all).into_iter().map(|t| t.map(|p| p * 1.04));
        assert_eq!(
            shell_size(&with([sphere(10.0, all), overlapping.collect()].concat())),
            Some(1024)
        );
        // The lower sixth is missing.
        assert!(shell_size(&with(sphere(10.0, |p| p.y > -6.5))).is_some());
    }

    #[test]
    fn a_triangle_covers_no_direction_but_the_near_ones() {
        let rng = Rng::new(9, "near", 0);
        let point =
            |i: u64| 2.0 * Vec3::from([0, 1, 2].map(|axis| rng.uniform(3 * i + axis))) - 1.0;
        let directions = directions();
        let mut small = 0;
        for i in 0..2000 {
            let size = [0.02, 0.3, 2.0][i as usize % 3];
            let triangle = [0, 1, 2].map(|k| point(4 * i) + size * point(4 * i + 1 + k));
            let cone = Cone::of(&triangle);
            let [faces, down, across] = near_directions(&triangle);
            small += u32::from(faces.len() * down.len() * across.len() <= 9);
            for (at, direction) in directions.iter().enumerate() {
                let face = at / GRID / GRID;
                let y = at / GRID % GRID;
                let x = at % GRID;
                let near = faces.contains(&face) && down.contains(&y) && across.contains(&x);
                assert!(near || !cone.contains(*direction), "{triangle:?}: {direction}");
            }
        }
        assert!(small > 500, "{small}");
    }

    #[test]
    fn far_triangles_without_a_closed_shell_stay_in_the_scene() {
        let with = |rest: Vec<[Vec3; 3]>| [things(4000, 1.0), rest].concat();
        assert_eq!(shell_size(&with(Vec::new())), None, "nothing far");
        assert_eq!(shell_size(&with(sphere(1.5, |_| true))), None, "a wall right behind");
        assert_eq!(shell_size(&with(sphere(10.0, |p| p.y > 0.0))), None, "half of it");
        assert_eq!(shell_size(&with(things(600, 12.0))), None, "scattered triangles");
        assert_eq!(shell_size(&sphere(10.0, |_| true)), None, "nothing before it");
        // A landscape that goes on to the horizon before a dome.
        assert_eq!(
            shell_size(&[things(4000, 1.0), things(4000, 9.0), sphere(10.0, |_| true)].concat()),
            None
        );
        assert_eq!(shell_size(&vec![[Vec3::NAN; 3]; 100]), None);
    }
}
