//! Pieces: triangles near each other, with a gap around them.

use crate::mesh::Mesh;
use glam::{IVec3, Vec3};
use std::collections::HashMap;

/// Side of a cell as a share of the scene's size: triangles in neighbouring cells belong together.
const CELL: f32 = 0.1;
/// Share of the triangles that determine the size of a scene.
const REACH: f64 = 0.9;
/// Points along each side of a triangle at most: those of larger ones may lie in cells apart, and still belong together.
const MOST_ALONG: u32 = 32;

/// Numbers the pieces of `faces`: the piece of each, in the order of `faces`, and the number of pieces.
pub(super) fn pieces(mesh: &Mesh, faces: &[u32]) -> (Vec<u32>, usize) {
    let centers: Vec<Vec3> = faces.iter().map(|face| mesh.centroid(*face as usize)).collect();
    let side = CELL * size(&centers);
    let mut cells = Cells::default();
    let cell_of: Vec<u32> =
        faces.iter().map(|face| cells.add(&covered(mesh.corners(*face as usize), side))).collect();
    cells.join_neighbours();
    let mut numbers = HashMap::new();
    let piece_of = cell_of.into_iter().map(|cell| {
        let next = numbers.len() as u32;
        *numbers.entry(cells.root(cell)).or_insert(next)
    });
    let piece_of: Vec<u32> = piece_of.collect();
    (piece_of, numbers.len())
}

/// Cells by their place, and which belong together.
#[derive(Default)]
struct Cells {
    at: HashMap<IVec3, u32>,
    /// Of each cell one that it belongs to: itself, or an earlier one.
    parent: Vec<u32>,
}

impl Cells {
    /// Adds cells that belong together; returns one of them.
    fn add(&mut self, places: &[IVec3]) -> u32 {
        let ids: Vec<u32> = places.iter().map(|place| self.id(*place)).collect();
        ids.iter().for_each(|id| self.join(ids[0], *id));
        ids[0]
    }

    fn id(&mut self, place: IVec3) -> u32 {
        let next = self.parent.len() as u32;
        let id = *self.at.entry(place).or_insert(next);
        if id == next {
            self.parent.push(next);
        }
        id
    }

    fn root(&mut self, mut cell: u32) -> u32 {
        while self.parent[cell as usize] != cell {
            let above = self.parent[cell as usize];
            self.parent[cell as usize] = self.parent[above as usize];
            cell = above;
        }
        cell
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    fn join_neighbours(&mut self) {
        let pairs: Vec<(u32, u32)> = self
            .at
            .iter()
            .flat_map(|(place, id)| neighbours(*place).filter_map(|n| Some((*id, *self.at.get(&n)?))))
            .collect();
        // The smallest of joined cells is the root, in whatever order they are joined.
        pairs.into_iter().for_each(|(a, b)| self.join(a, b));
    }
}

/// The cells that a triangle goes through. At least one.
fn covered(corners: [Vec3; 3], side: f32) -> Vec<IVec3> {
    let [a, b, c] = corners;
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    let along = ((longest / side).ceil() as u32).clamp(1, MOST_ALONG);
    let cell = |point: Vec3| if side > 0.0 { (point / side).floor().as_ivec3() } else { IVec3::ZERO };
    let mut cells: Vec<IVec3> = (0..=along)
        .flat_map(|i| (0..=along - i).map(move |j| [i, j].map(|n| n as f32 / along as f32)))
        .map(|[u, v]| cell(a + u * (b - a) + v * (c - a)))
        .collect();
    cells.dedup();
    cells
}

fn neighbours(cell: IVec3) -> impl Iterator<Item = IVec3> {
    let along = |n: i32| IVec3::new(n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
    // Cells at the end of the range of 32 bits have no neighbours beyond it.
    (0..27).map(move |n| cell.saturating_add(along(n)))
}

/// The distance from the median centre within which [`REACH`] of the centres lie.
fn size(centers: &[Vec3]) -> f32 {
    if centers.is_empty() {
        return 0.0;
    }
    let median = |axis: usize| {
        let mut values: Vec<f32> = centers.iter().map(|c| c[axis]).collect();
        let middle = values.len() / 2;
        *values.select_nth_unstable_by(middle, f32::total_cmp).1
    };
    let middle = Vec3::from_array([0, 1, 2].map(median));
    let mut distances: Vec<f32> = centers.iter().map(|c| c.distance(middle)).collect();
    let at = ((distances.len() - 1) as f64 * REACH) as usize;
    *distances.select_nth_unstable_by(at, f32::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    #[test]
    fn a_gap_parts_pieces_and_order_does_not() {
        let rng = Rng::new(3, "pieces", 0);
        let point = |n: u64| Vec3::from_array([0, 1, 2].map(|axis| rng.uniform(3 * n + axis)));
        let away = |n: u64| if n % 9 == 0 { 4.0 * Vec3::X } else { Vec3::ZERO };
        let corners: Vec<Vec3> = (0..900).map(|n| away(n) + point(n)).collect();
        let positions = corners.iter().flat_map(|c| [*c, c + Vec3::X * 0.01, c + Vec3::Y * 0.01]).collect();
        let mesh = Mesh { positions, ..Mesh::default() };
        let faces: Vec<u32> = (0..900).rev().collect();
        let (piece_of, count) = pieces(&mesh, &faces);
        assert_eq!(count, 2);
        // Face 899 is the first, and not one of each ninth.
        assert!(faces.iter().zip(&piece_of).all(|(face, piece)| *piece == u32::from(face % 9 == 0)));
    }
}
