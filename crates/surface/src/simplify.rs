//! Fewer triangles for the same surface: pieces too small for what is left go, edges collapse by
//! the quadric errors of meshoptimizer, and where the topology permits no more of that, vertices
//! are joined and edges collapse again.

use crate::collapse::{COLOR_WEIGHT, vertex_data};
use crate::fill::{Components, drop_small_areas};
use glam::{DMat3, DVec3, UVec3, Vec3};
use meshopt::SimplifyOptions;
use std::collections::HashSet;
use trisplat_scene::Error;
use trisplat_scene::math::color::srgb_from_linear;
use trisplat_scene::mesh::{Colors, Mesh};

/// A piece whose share of the area is worth fewer triangles is dropped: an octahedron has as many.
const MIN_FACES_PER_PIECE: f64 = 8.0;
/// Maximum number of triangles that edge collapses start from, per triangle that stays: their time
/// has no other bound.
const MAX_FACES_PER_KEPT_FACE: usize = 512;
/// Side of the first cells in which vertices are joined, in the length of the mean edge.
const FIRST_CELL: f32 = 2.0;
/// Growth of the cells from round to round.
const NEXT_CELL: f32 = 1.5;

/// Edge collapses that leave less of the surface's extent along an axis are not used.
const MIN_SIZE: f32 = 0.5;

/// Result of simplification.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Simplified {
    /// Estimated movement of the surface, units of the mesh.
    pub(super) error: f64,
    /// Components kept and dropped for the triangle limit.
    pub(super) pieces: Components,
}

/// A triangle limit below the fewest triangles that still show the surface.
#[derive(Debug)]
pub(super) struct TooFewTriangles {
    limit: usize,
    fewest_triangles: usize,
}

impl TooFewTriangles {
    /// The error of the `option` that sets the limit.
    pub(super) fn of_option(self, option: &str) -> Error {
        let Self { limit, fewest_triangles } = self;
        let wants = format!(
            "more: of this surface {fewest_triangles} triangles are left, and with fewer nothing"
        );
        Error::invalid(option, limit, wants)
    }
}

/// Simplifies an indexed mesh with colours per vertex to at most `max_faces` faces; `None` when it
/// had no more already.
///
/// # Errors
///
/// A surface that so few triangles cannot show.
pub(super) fn simplify(
    mesh: &mut Mesh,
    max_faces: usize,
) -> Result<Option<Simplified>, TooFewTriangles> {
    if mesh.face_count() <= max_faces {
        return Ok(None);
    }
    let pieces = drop_small_areas(mesh, MIN_FACES_PER_PIECE / max_faces as f64);
    let mut side = FIRST_CELL * mean_edge(mesh);
    let whole = size(mesh);
    let mut error = 0.0;
    while mesh.face_count() > max_faces.saturating_mul(MAX_FACES_PER_KEPT_FACE) {
        error += cluster(mesh, side);
        side *= NEXT_CELL;
    }
    let mut fewest_triangles = mesh.face_count();
    while mesh.face_count() > max_faces {
        let mut collapsed = mesh.clone();
        let distance = collapse(&mut collapsed, max_faces);
        // Collapses may end with nothing or with a corner of it, too; then the vertices are joined
        // that there were.
        if size(&collapsed).cmpge(MIN_SIZE * whole).all() && collapsed.face_count() > 0 {
            *mesh = collapsed;
            error += distance;
        }
        if mesh.face_count() > max_faces {
            fewest_triangles = mesh.face_count();
            error += cluster(mesh, side);
            side *= NEXT_CELL;
        }
    }
    if check(mesh, max_faces) {
        Ok(Some(Simplified { error, pieces }))
    } else {
        Err(TooFewTriangles { limit: max_faces, fewest_triangles })
    }
}

/// Collapses edges until `max_faces` faces are left, or the topology permits no more. Returns how
/// far the surface moved.
fn collapse(mesh: &mut Mesh, max_faces: usize) -> f64 {
    let Colors::Vertex(colors) = &mesh.colors else { return 0.0 };
    let codes: Vec<f32> =
        colors.iter().flatten().map(|channel| srgb_from_linear(*channel)).collect();
    let Some((vertices, scale)) = vertex_data(&mesh.positions) else { return 0.0 };
    let mut error = 0.0;
    // No vertex is locked. An empty list would be read beyond its end. Not `Prune`: where the
    // topology keeps a piece above `max_faces`, it drops one piece after the other until none is
    // left.
    mesh.indices = meshopt::simplify_with_attributes_and_locks(
        &mesh.indices,
        &vertices,
        &codes,
        &[COLOR_WEIGHT; 3],
        3 * size_of::<f32>(),
        &vec![false; mesh.vertex_count()],
        3 * max_faces,
        f32::MAX,
        SimplifyOptions::None,
        Some(&mut error),
    );
    drop_unused(mesh);
    f64::from(error * scale)
}

/// Extent along each axis.
fn size(mesh: &Mesh) -> Vec3 {
    let low = mesh.positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
    mesh.positions.iter().copied().reduce(Vec3::max).unwrap_or_default() - low
}

fn mean_edge(mesh: &Mesh) -> f32 {
    let edges = |face| {
        let [a, b, c] = mesh.corners(face);
        f64::from(a.distance(b) + b.distance(c) + c.distance(a))
    };
    ((0..mesh.face_count()).map(edges).sum::<f64>() / (3 * mesh.face_count()).max(1) as f64) as f32
}

/// True of an indexed mesh of 1 to `max_faces` faces of three vertices each.
fn check(mesh: &Mesh, max_faces: usize) -> bool {
    let whole = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
    (1..=max_faces).contains(&mesh.face_count())
        && mesh.indices.len() == 3 * mesh.face_count()
        && mesh.indices.as_chunks::<3>().0.iter().all(whole)
        && mesh.validate().is_ok()
}

// ---- Vertex clustering (Rossignac and Borrel 1993) ----------------------------------------------

/// Maximum number of cells along an axis: three such numbers fit into one of 64 bits.
const MAX_CELLS: f32 = (1 << 20) as f32;

/// Joins the vertices in cells of side `side`; each cell keeps the vertex nearest to the planes of
/// its triangles. Triangles that become lines or repeat another go. Returns how far the surface
/// moved, units of the mesh, root mean square over the cell that moved most.
pub(super) fn cluster(mesh: &mut Mesh, side: f32) -> f64 {
    let cells = cells(&mesh.positions, side);
    let (vertices, distance) = choose_vertices(mesh, &cells);
    let mut distinct = HashSet::new();
    let indices = mesh
        .indices
        .as_chunks::<3>()
        .0
        .iter()
        .map(|face| face.map(|v| vertices[cells[v as usize] as usize]));
    let flat = |[a, b, c]: &[u32; 3]| a == b || b == c || c == a;
    let faces: Vec<[u32; 3]> =
        indices.filter(|face| !flat(face) && distinct.insert(smallest_first(*face))).collect();
    mesh.indices = faces.into_flattened();
    drop_unused(mesh);
    distance
}

/// Drops the vertices that no face uses, all of them when there are no faces.
pub(super) fn drop_unused(mesh: &mut Mesh) {
    let faces = mesh.indices.len() / 3;
    if faces == 0 {
        // Vertices without indices would be triangles.
        return mesh.clear();
    }
    mesh.retain(|face| face < faces);
}

/// The same face, its smallest vertex number first.
fn smallest_first([a, b, c]: [u32; 3]) -> [u32; 3] {
    let smallest = a.min(b).min(c);
    if smallest == a {
        [a, b, c]
    } else if smallest == b {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// Cell of each vertex, numbered from 0 in the order of space. `[V]`
fn cells(positions: &[Vec3], side: f32) -> Vec<u32> {
    let low = positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = positions.iter().copied().reduce(Vec3::max).unwrap_or_default();
    let side = side.max((high - low).max_element() / MAX_CELLS).max(f32::MIN_POSITIVE);
    let number = |p: &Vec3| {
        let UVec3 { x, y, z } = ((*p - low) / side).as_uvec3();
        u64::from(x) << 42 | u64::from(y) << 21 | u64::from(z)
    };
    let numbers: Vec<u64> = positions.iter().map(number).collect();
    let mut distinct = numbers.clone();
    distinct.sort_unstable();
    distinct.dedup();
    numbers.iter().map(|number| distinct.partition_point(|other| other < number) as u32).collect()
}

/// Sum of squared distances from planes, weighted by area.
#[derive(Clone, Copy, Default)]
struct Quadric {
    squares: DMat3,
    linear: DVec3,
    constant: f64,
    area: f64,
}

impl Quadric {
    fn add(&mut self, normal: DVec3, offset: f64, area: f64) {
        self.squares +=
            DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z) * area;
        self.linear += normal * (offset * area);
        self.constant += offset * offset * area;
        self.area += area;
    }

    fn at(&self, p: DVec3) -> f64 {
        (p.dot(self.squares * p) + 2.0 * self.linear.dot(p) + self.constant).max(0.0)
    }
}

/// The vertex that each cell keeps, and how far the surface moved.
fn choose_vertices(mesh: &Mesh, cells: &[u32]) -> (Vec<u32>, f64) {
    let count = cells.iter().max().map_or(0, |last| *last as usize + 1);
    // Distances are of numbers near zero: relative to a vertex of the cell.
    let mut origins = vec![DVec3::ZERO; count];
    for (cell, p) in cells.iter().zip(&mesh.positions) {
        origins[*cell as usize] = p.as_dvec3();
    }
    let mut quadrics = vec![Quadric::default(); count];
    for face in 0..mesh.face_count() {
        let [a, b, c] = mesh.corners(face).map(|p| p.as_dvec3());
        let cross = (b - a).cross(c - a);
        let normal = cross.normalize_or_zero();
        let area = cross.length() / 2.0;
        for vertex in mesh.face(face) {
            let cell = cells[vertex as usize] as usize;
            quadrics[cell].add(normal, normal.dot(origins[cell] - a), area);
        }
    }
    let mut best = vec![(f64::INFINITY, 0u32); count];
    for (vertex, (cell, p)) in cells.iter().zip(&mesh.positions).enumerate() {
        let cell = *cell as usize;
        let error = quadrics[cell].at(p.as_dvec3() - origins[cell]);
        if error < best[cell].0 {
            best[cell] = (error, vertex as u32);
        }
    }
    let mean_error = |((error, _), quadric): (&(f64, u32), &Quadric)| {
        error / quadric.area.max(f64::MIN_POSITIVE)
    };
    let max_error =
        best.iter().zip(&quadrics).map(mean_error).filter(|m| m.is_finite()).fold(0.0, f64::max);
    (best.into_iter().map(|(_, vertex)| vertex).collect(), max_error.sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::IVec3;
    use std::collections::HashMap;

    /// Every other cube of a block of n³: all their edges are shared by four faces, so that no edge
    /// may collapse.
    fn checkerboard(n: i32) -> Mesh {
        let mut mesh = Mesh { colors: Colors::Vertex(Vec::new()), ..Mesh::default() };
        let mut numbers = HashMap::new();
        let mut vertex = |mesh: &mut Mesh, at: IVec3| {
            *numbers.entry(at).or_insert_with(|| {
                mesh.positions.push(at.as_vec3() / n as f32);
                if let Colors::Vertex(colors) = &mut mesh.colors {
                    colors.push([0.5; 3]);
                }
                mesh.positions.len() as u32 - 1
            })
        };
        let cubes = (0..n * n * n).map(|i| IVec3::new(i % n, i / n % n, i / n / n));
        for cube in cubes.filter(|cube| cube.element_sum() % 2 == 0) {
            for axis in 0..3 {
                let [a, b, c] = [0, 1, 2].map(|k| IVec3::AXES[(axis + k) % 3]);
                for (side, [b, c]) in [(IVec3::ZERO, [c, b]), (a, [b, c])] {
                    let [p, q, r, s] = [IVec3::ZERO, b, b + c, c]
                        .map(|corner| vertex(&mut mesh, cube + side + corner));
                    mesh.indices.extend([p, q, r, p, r, s]);
                }
            }
        }
        mesh
    }

    /// A closed ball of 8 · 4^levels triangles around `center`.
    fn ball(center: Vec3, radius: f32, levels: u32) -> Mesh {
        let (corners, faces) = trisplat_scene::math::geometry::octasphere(levels);
        Mesh {
            colors: Colors::Vertex(vec![[0.5; 3]; corners.len()]),
            positions: corners.into_iter().map(|c| center + radius * c).collect(),
            indices: faces.into_flattened(),
            ..Mesh::default()
        }
    }

    fn simplified(mesh: &Mesh, max_faces: usize) -> Result<Mesh, Error> {
        let mut mesh = mesh.clone();
        let details = simplify(&mut mesh, max_faces)
            .map_err(|error| error.of_option("max_triangles"))?
            .expect("there is something to do");
        assert!(details.error.is_finite() && check(&mesh, max_faces), "{max_faces}: {details:?}");
        Ok(mesh)
    }

    #[test]
    fn what_edge_collapses_would_empty_ends_within_its_budget() {
        let mesh = checkerboard(12);
        assert_eq!(mesh.face_count(), 864 * 12);
        let (vertices, _) = vertex_data(&mesh.positions).unwrap();
        let with =
            |how| meshopt::simplify(&mesh.indices, &vertices, 3 * 50, f32::MAX, how, None).len();
        assert_eq!(
            [SimplifyOptions::Prune, SimplifyOptions::None].map(with),
            [0, 0],
            "the hard case"
        );
        for max_faces in [2000, 400, 100, 50] {
            let simple = simplified(&mesh, max_faces).unwrap();
            assert!(size(&simple).cmpge(0.5 * size(&mesh)).all(), "{max_faces}: {}", size(&simple));
        }
    }

    #[test]
    fn too_few_triangles_are_an_error_and_not_a_wrong_file() {
        let mut enough = 0;
        for max_faces in 1..40 {
            match simplified(&checkerboard(4), max_faces) {
                Ok(_) => enough += 1,
                Err(error) => assert!(error.to_string().starts_with("max_triangles is"), "{error}"),
            }
        }
        assert!(enough > 20, "{enough}");
        let error = simplified(&ball(Vec3::ZERO, 1.0, 4), 1)
            .expect_err("one triangle is no ball")
            .to_string();
        assert!(error.contains("max_triangles is 1") && error.contains("more"), "{error}");
    }

    #[test]
    fn simplify_drops_small_pieces_and_keeps_the_shape() {
        let mut mesh = ball(Vec3::ZERO, 1.0, 5);
        for i in 0..100 {
            mesh.append(ball(Vec3::X * (3.0 + i as f32), 0.01, 2)).unwrap();
        }
        let simple = simplified(&mesh, 200).unwrap();
        assert!((100..=200).contains(&simple.face_count()));
        assert!(
            simple.positions.iter().all(|p| (0.95..1.05).contains(&p.length())),
            "the large one is left"
        );
    }
}
