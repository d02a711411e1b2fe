//! The shell of a trained scene as its backdrop.
//!
//! Training closes a scene with a shell of triangles where it has no points. Part of the scene, it would be an opaque ball around it for
//! whoever looks from outside, as every viewer does that frames a file. As the backdrop it is seen from within only.

use crate::camera::Camera;
use crate::mesh::Mesh;
use crate::soup::Soup;
use glam::Vec3;
use rayon::prelude::*;

/// A corner this close to the shell lies in it, in the radius of the shell: solid triangles shrink a little, and reshaping moves them.
const THICKNESS: f32 = 0.02;
/// How far beyond the circle around a triangle of the shell a corner still belongs to it, in that circle's radius.
const REACH: f32 = 1.2;

/// A budget of triangles keeps a shell as it is when it is worth this many of them.
const LEAST_SHELLS: u64 = 8;

/// The surface of a shell.
#[derive(Debug, Default)]
pub(super) struct Shell {
    triangles: Vec<ShellTriangle>,
    center: Vec3,
    radius: f32,
    /// No part of it is nearer to the middle.
    nearest: f32,
}

#[derive(Debug)]
struct ShellTriangle {
    centroid: Vec3,
    normal: Vec3,
    radius: f32,
}

impl Shell {
    /// The first `count` triangles of a soup, which are around all `cameras`.
    pub(super) fn of(soup: &Soup, count: usize, cameras: &[Camera]) -> Self {
        let triangles: Vec<ShellTriangle> =
            soup.vertices.iter().take(count).map(|corners| ShellTriangle::of(*corners)).collect();
        let mean = |points: &mut dyn ExactSizeIterator<Item = Vec3>| {
            let count = points.len().max(1) as f32;
            points.sum::<Vec3>() / count
        };
        // Of a shell that is open to one side, as where nobody looked, the middle may lie behind some of it.
        let center = match cameras.is_empty() {
            true => mean(&mut triangles.iter().map(|t| t.centroid)),
            false => mean(&mut cameras.iter().map(Camera::position)),
        };
        let radius = triangles.iter().map(|t| t.centroid.distance(center)).sum::<f32>();
        let radius = radius / triangles.len().max(1) as f32;
        let inner = |t: &ShellTriangle| t.centroid.distance(center) - REACH * t.radius;
        let nearest = triangles.iter().map(inner).fold(f32::INFINITY, f32::min) - THICKNESS * radius;
        Self { triangles, center, radius, nearest }
    }

    /// Takes the faces that lie in the shell out of `mesh`, their fronts inside.
    pub(super) fn take_from(&self, mesh: &mut Mesh) -> Mesh {
        if self.triangles.is_empty() || mesh.face_count() == 0 {
            return Mesh::default();
        }
        let inside = self.faces_in(mesh);
        let mut shell = mesh.clone();
        shell.retain(|face| inside[face]);
        mesh.retain(|face| !inside[face]);
        for face in 0..shell.face_count() {
            if shell.flat_normal(face).dot(self.center - shell.centroid(face)) < 0.0 {
                shell.flip(face);
            }
        }
        shell
    }

    /// The faces of the shell in `mesh`, when the mesh is larger than `budget` and they are a small part of that: dropping half of a closed surface saves
    /// little, and leaves holes wherever no camera looks. None otherwise: smaller budgets are spent on what cameras see. `[F]`
    pub(super) fn spared_in(&self, mesh: &Mesh, budget: Option<u64>) -> Vec<bool> {
        let Some(budget) = budget.filter(|most| *most < mesh.face_count() as u64) else { return Vec::new() };
        let inside = self.faces_in(mesh);
        let count = inside.iter().filter(|inside| **inside).count() as u64;
        if (1..=budget / LEAST_SHELLS).contains(&count) { inside } else { Vec::new() }
    }

    /// Whether each face of `mesh` lies in the shell. `[F]`
    fn faces_in(&self, mesh: &Mesh) -> Vec<bool> {
        let inside = |face| mesh.corners(face).iter().all(|p| self.holds(*p));
        (0..mesh.face_count()).into_par_iter().map(inside).collect()
    }

    /// Whether a point lies in the surface.
    fn holds(&self, point: Vec3) -> bool {
        let near = |t: &ShellTriangle| {
            let across = point - t.centroid;
            across.length_squared() <= (REACH * t.radius).powi(2)
                && across.dot(t.normal).abs() <= THICKNESS * self.radius
        };
        // Most of a scene is well within.
        point.distance(self.center) >= self.nearest && self.triangles.iter().any(near)
    }
}

impl ShellTriangle {
    fn of(corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners;
        let centroid = (a + b + c) / 3.0;
        let radius = corners.iter().map(|p| p.distance(centroid)).fold(0.0, f32::max);
        Self { centroid, normal: (b - a).cross(c - a).normalize_or_zero(), radius }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Colors;

    /// An octahedron of radius 10 as a shell, wound outward.
    fn octahedron() -> Vec<[Vec3; 3]> {
        let faces = (0..8).map(|i| {
            let sign = |axis: usize| if i >> axis & 1 == 0 { 10.0 } else { -10.0 };
            let [x, y, z] = [Vec3::X * sign(0), Vec3::Y * sign(1), Vec3::Z * sign(2)];
            if (y - x).cross(z - x).dot(x) > 0.0 { [x, y, z] } else { [x, z, y] }
        });
        faces.collect()
    }

    #[test]
    fn what_lies_in_the_shell_is_taken_and_turned_inward_and_the_rest_stays() {
        let soup = Soup { vertices: octahedron(), ..Soup::default() };
        let shell = Shell::of(&soup, 8, &[]);
        // The shell as it is drawn, shrunk a little; a triangle well before it, and one that leans against it.
        let shrunk = |t: &[Vec3; 3]| {
            let middle = (t[0] + t[1] + t[2]) / 3.0;
            t.map(|p| middle + 0.97 * (p - middle))
        };
        let mut triangles: Vec<[Vec3; 3]> = octahedron().iter().map(shrunk).collect();
        triangles.push([Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::splat(1.0)));
        triangles.push([Vec3::ZERO, Vec3::splat(3.3), Vec3::new(3.0, 3.5, 3.5)]);
        let colors = Colors::Face(vec![[0.5; 3]; triangles.len()]);
        let mut mesh = Mesh { positions: triangles.into_flattened(), colors, ..Mesh::default() };
        let taken = shell.take_from(&mut mesh);
        assert_eq!((taken.face_count(), mesh.face_count()), (8, 2));
        assert!((0..8).all(|f| taken.flat_normal(f).dot(taken.centroid(f)) < 0.0), "fronts are inside");
        assert_eq!(Shell::default().take_from(&mut mesh).face_count(), 0);
    }

    #[test]
    fn a_shell_is_spared_where_it_is_a_small_part_of_a_budget() {
        let soup = Soup { vertices: octahedron(), ..Soup::default() };
        let shell = Shell::of(&soup, 8, &[]);
        let within =
            (0..100).map(|i| [Vec3::ZERO, Vec3::X, Vec3::Y].map(|p| p + Vec3::X * (i as f32 / 100.0)));
        let triangles: Vec<[Vec3; 3]> = octahedron().into_iter().chain(within).collect();
        let colors = Colors::Face(vec![[0.5; 3]; triangles.len()]);
        let whole = Mesh { positions: triangles.into_flattened(), colors, ..Mesh::default() };
        for (budget, spared) in [(None, 0), (Some(108), 0), (Some(107), 8), (Some(64), 8), (Some(63), 0)] {
            let faces = shell.spared_in(&whole, budget);
            assert_eq!(faces.iter().filter(|face| **face).count(), spared, "{budget:?}");
            assert!(faces.iter().skip(8).all(|face| !face), "{budget:?}");
            assert_eq!(faces.is_empty(), spared == 0, "{budget:?}");
        }
        assert!(Shell::default().spared_in(&whole, Some(64)).is_empty(), "room is left for another backdrop");
    }
}
