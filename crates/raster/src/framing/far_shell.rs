//! Recognises a far shell: triangles far behind the rest that close a scene all around, such as the sky dome
//! of a sample or the environment ball of another program.
//!
//! Four things must hold. There is a gap between them and the scene; they are far behind it; they face its middle; and they cover most
//! directions. Walls of a room fail the first or the second, a distant landscape the third or the fourth.

use glam::Vec3;
use trisplat_scene::math::median::median;
use trisplat_scene::parallel::{self, GRAIN};

/// Number of triangles for finding the gap.
const SAMPLE: usize = 50_000;
/// Scenes with fewer triangles have no shell.
const LEAST_TRIANGLES: usize = 64;
/// Least distance of the shell, as a multiple of the median distance of the scene.
const FAR: f32 = 2.5;
/// The gap: the empty share of the distance to the shell ...
const GAP: f32 = 0.25;
/// ... except for this many triangles, as a share of those of the shell.
const MOST_IN_GAP: f32 = 0.02;
/// Largest share of the triangles in a shell.
const MOST_SHELL: f32 = 0.4;
/// Least mean cosine, by area, between the shell's normals and the direction to the middle.
const LEAST_FACING: f32 = 0.8;
/// Least share of all directions that the shell covers.
const LEAST_COVERED: f32 = 0.7;
/// Number of tested directions: lines of the grid on each face of a cube.
const GRID: usize = 8;

/// Flags of the `count` triangles, given by their `corners`, that are a far shell; `None` without one. `[N]`
pub fn far_shell(corners: &(dyn Fn(usize) -> [Vec3; 3] + Sync), count: usize) -> Option<Vec<bool>> {
    if count < LEAST_TRIANGLES {
        return None;
    }
    let middle = |face: usize| {
        let [a, b, c] = corners(face);
        (a + b + c) / 3.0
    };
    let sampled: Vec<Vec3> =
        (0..count).step_by(count.div_ceil(SAMPLE)).map(middle).filter(|p| p.is_finite()).collect();
    let along = |axis: usize| median(sampled.iter().map(|p| p[axis]).collect(), f32::total_cmp);
    let center = Vec3::new(along(0)?, along(1)?, along(2)?);
    let mut distances: Vec<f32> = sampled.iter().map(|p| p.distance(center)).collect();
    distances.sort_unstable_by(f32::total_cmp);
    let from = begin(&distances)?;
    let is_far: Vec<bool> = parallel::collect(count, GRAIN, |face| middle(face).distance(center) >= from);
    let far: Vec<[Vec3; 3]> =
        (0..count).filter(|face| is_far[*face]).map(|face| corners(face).map(|p| p - center)).collect();
    (faces_middle(&far) && covers(&far)).then_some(is_far)
}

/// The distance at which the shell begins, from the sorted distances of triangles.
fn begin(distances: &[f32]) -> Option<f32> {
    let half = *distances.get(distances.len() / 2)?;
    let least = FAR * half;
    let first = distances.partition_point(|d| *d < least);
    let candidates = (first..distances.len()).filter(|at| {
        let from = distances[*at];
        let shell = distances.len() - at;
        let gap = at - distances.partition_point(|d| *d < (1.0 - GAP) * from);
        from > 0.0
            && shell as f32 <= MOST_SHELL * distances.len() as f32
            && gap as f32 <= MOST_IN_GAP * shell as f32
    });
    candidates.map(|at| distances[at]).next()
}

/// Whether triangles around the origin face it.
fn faces_middle(far: &[[Vec3; 3]]) -> bool {
    let (mut facing, mut area) = (0.0f64, 0.0f64);
    for [a, b, c] in far {
        let normal = (*b - *a).cross(*c - *a);
        facing += f64::from(normal.dot(((*a + *b + *c) / 3.0).normalize_or_zero()).abs());
        area += f64::from(normal.length());
    }
    area > 0.0 && facing >= f64::from(LEAST_FACING) * area
}

/// Whether the triangles cover most directions from the origin.
fn covers(far: &[[Vec3; 3]]) -> bool {
    let directions = directions();
    let cones: Vec<Cone> = far.iter().map(Cone::of).collect();
    let is_covered = |i: usize| cones.iter().any(|cone| cone.contains(directions[i]));
    let covered = parallel::collect(directions.len(), 1, is_covered);
    covered.iter().filter(|covered| **covered).count() as f32 >= LEAST_COVERED * directions.len() as f32
}

/// The directions from the origin in which a triangle lies.
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
        let (axis, sign) = (face / 2, if face.is_multiple_of(2) { 1.0 } else { -1.0 });
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

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Rng;
    use trisplat_scene::math::octasphere::octasphere;

    /// Small triangles in a ball of this radius.
    fn things(count: u64, radius: f32) -> Vec<[Vec3; 3]> {
        let rng = Rng::new(8, "things", count);
        let point = |i: u64| 2.0 * Vec3::from([0, 1, 2].map(|axis| rng.uniform(3 * i + axis))) - 1.0;
        (0..count).map(|i| [0, 1, 2].map(|k| radius * (point(2 * i) + 0.05 * point(2 * i + 1 + k)))).collect()
    }

    fn sphere(radius: f32, keep: impl Fn(Vec3) -> bool) -> Vec<[Vec3; 3]> {
        let (corners, faces) = octasphere(3);
        let triangles = faces.iter().map(|face| face.map(|i| radius * corners[i as usize]));
        triangles.filter(|[a, b, c]| keep((*a + *b + *c) / 3.0)).collect()
    }

    fn found(triangles: &[[Vec3; 3]]) -> Option<usize> {
        let is_far = far_shell(&|face| triangles[face], triangles.len())?;
        Some(is_far.iter().filter(|far| **far).count())
    }

    #[test]
    fn a_closed_far_shell_of_any_soup_is_recognised() {
        let all = |_| true;
        let with = |shell: Vec<[Vec3; 3]>| [things(4000, 1.0), shell].concat();
        assert_eq!(found(&with(sphere(10.0, all))), Some(512));
        // Triangles that overlap, as trained ones do, and are not quite on it.
        let overlapping = sphere(10.0, all).into_iter().map(|t| t.map(|p| p * 1.04));
        assert_eq!(found(&with([sphere(10.0, all), overlapping.collect()].concat())), Some(1024));
        // The lower sixth is missing.
        assert!(found(&with(sphere(10.0, |p| p.y > -6.5))).is_some());
    }

    #[test]
    fn what_is_no_shell_stays_in_the_scene() {
        let with = |rest: Vec<[Vec3; 3]>| [things(4000, 1.0), rest].concat();
        assert_eq!(found(&with(Vec::new())), None, "nothing far");
        assert_eq!(found(&with(sphere(1.5, |_| true))), None, "a wall right behind");
        assert_eq!(found(&with(sphere(10.0, |p| p.y > 0.0))), None, "half of it");
        assert_eq!(found(&with(things(600, 12.0))), None, "scattered triangles");
        assert_eq!(found(&sphere(10.0, |_| true)), None, "nothing before it");
        // A landscape that goes on to the horizon before a dome.
        assert_eq!(found(&[things(4000, 1.0), things(4000, 9.0), sphere(10.0, |_| true)].concat()), None);
        assert_eq!(found(&vec![[Vec3::NAN; 3]; 100]), None);
    }
}
