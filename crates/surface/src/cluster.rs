//! Vertex clustering: all vertices of one cell of a grid become one of them (Rossignac and Borrel 1993). It reaches any number of
//! triangles, as it may join what lies close together; edge collapses, which keep the topology, may not.

use glam::{DMat3, DVec3, UVec3, Vec3};
use std::collections::HashSet;
use trisplat_scene::mesh::Mesh;

/// Most cells along an axis: three such numbers fit into one of 64 bits.
const MOST_CELLS: f32 = (1 << 20) as f32;

/// Joins the vertices in cells of side `side`; each cell keeps the vertex nearest to the planes of its triangles. Triangles that become
/// lines or repeat another go. Returns how far the surface moved, units of the mesh, root mean square over the cell that moved most.
pub(super) fn cluster(mesh: &mut Mesh, side: f32) -> f64 {
    let cells = cells(&mesh.positions, side);
    let (kept, moved) = chosen(mesh, &cells);
    let mut seen = HashSet::new();
    let indices =
        mesh.indices.as_chunks::<3>().0.iter().map(|face| face.map(|v| kept[cells[v as usize] as usize]));
    let flat = |[a, b, c]: &[u32; 3]| a == b || b == c || c == a;
    let faces: Vec<[u32; 3]> = indices.filter(|face| !flat(face) && seen.insert(turned(*face))).collect();
    mesh.indices = faces.into_flattened();
    drop_unused(mesh);
    moved
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

/// The same face, its least vertex first.
fn turned([a, b, c]: [u32; 3]) -> [u32; 3] {
    let least = a.min(b).min(c);
    if least == a {
        [a, b, c]
    } else if least == b {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// Which cell each vertex is in, numbered from 0 in the order of space. `[V]`
fn cells(positions: &[Vec3], side: f32) -> Vec<u32> {
    let low = positions.iter().copied().reduce(Vec3::min).unwrap_or_default();
    let high = positions.iter().copied().reduce(Vec3::max).unwrap_or_default();
    let side = side.max((high - low).max_element() / MOST_CELLS).max(f32::MIN_POSITIVE);
    let number = |p: &Vec3| {
        let UVec3 { x, y, z } = ((*p - low) / side).as_uvec3();
        u64::from(x) << 42 | u64::from(y) << 21 | u64::from(z)
    };
    let numbers: Vec<u64> = positions.iter().map(number).collect();
    let mut sorted = numbers.clone();
    sorted.sort_unstable();
    sorted.dedup();
    numbers.iter().map(|number| sorted.partition_point(|other| other < number) as u32).collect()
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
        self.squares += DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z) * area;
        self.linear += normal * (offset * area);
        self.constant += offset * offset * area;
        self.area += area;
    }

    fn at(&self, p: DVec3) -> f64 {
        (p.dot(self.squares * p) + 2.0 * self.linear.dot(p) + self.constant).max(0.0)
    }
}

/// The vertex that each cell keeps, and how far the surface moved.
fn chosen(mesh: &Mesh, cells: &[u32]) -> (Vec<u32>, f64) {
    let count = cells.iter().max().map_or(0, |last| *last as usize + 1);
    // Distances are of numbers near zero: relative to a vertex of the cell.
    let mut origins = vec![DVec3::ZERO; count];
    cells.iter().zip(&mesh.positions).for_each(|(cell, p)| origins[*cell as usize] = p.as_dvec3());
    let mut quadrics = vec![Quadric::default(); count];
    for face in 0..mesh.face_count() {
        let [a, b, c] = mesh.corners(face).map(|p| p.as_dvec3());
        let cross = (b - a).cross(c - a);
        let (normal, area) = (cross.normalize_or_zero(), cross.length() / 2.0);
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
    let moved = |((error, _), quadric): (&(f64, u32), &Quadric)| error / quadric.area.max(f64::MIN_POSITIVE);
    let most = best.iter().zip(&quadrics).map(moved).filter(|m| m.is_finite()).fold(0.0, f64::max);
    (best.into_iter().map(|(_, vertex)| vertex).collect(), most.sqrt())
}
