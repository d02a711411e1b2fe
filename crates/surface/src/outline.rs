//! Borders without teeth: where a surface ends, its last triangles are as ragged as the cells that
//! something observed.

use crate::fill::border;
use glam::Vec3;
use std::collections::BTreeMap;
use trisplat_scene::mesh::Mesh;

/// Rounds of smoothing: teeth of a cell or two vanish, and an outline stays where it is.
const ROUNDS: u32 = 10;

/// Moves the vertices of borders halfway to the middle between their neighbours along the border,
/// [`ROUNDS`] times. Vertices where borders touch stay.
pub(super) fn smooth_border(mesh: &mut Mesh) {
    let after = border(mesh);
    let mut before: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for (vertex, next) in after.iter().flat_map(|(v, next)| next.iter().map(move |n| (*v, *n))) {
        before.entry(next).or_default().push(vertex);
    }
    let between = |vertex: &u32| match (after[vertex].as_slice(), before.get(vertex)?.as_slice()) {
        ([next], [previous]) => Some([*vertex, *previous, *next].map(|v| v as usize)),
        _ => None,
    };
    let border: Vec<[usize; 3]> = after.keys().filter_map(between).collect();
    for _ in 0..ROUNDS {
        let place = |v: usize| mesh.positions[v];
        let moved: Vec<Vec3> =
            border.iter().map(|&[v, a, b]| 0.5 * place(v) + 0.25 * (place(a) + place(b))).collect();
        for ([vertex, ..], place) in border.iter().zip(moved) {
            mesh.positions[*vertex] = place;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fill::tests::sheet;

    #[test]
    fn teeth_of_a_border_vanish_and_the_rest_stays() {
        // Every second cell of the last row is missing.
        let mut mesh = sheet(20, &[0, 2, 4, 6, 8, 10, 12, 14, 16, 18].map(|x| (x, 19)));
        let whole = mesh.positions.clone();
        smooth_border(&mut mesh);
        let is_near = |v: usize, from: f32, to: f32| (from..=to).contains(&whole[v].y);
        let of_row = |row: f32| (0..whole.len()).filter(move |v| is_near(*v, row, row));
        // Away from the corners, which become round.
        let height = |v: usize| (5.0..16.0).contains(&whole[v].x).then(|| mesh.positions[v].y);
        let teeth: Vec<f32> = of_row(19.0).chain(of_row(20.0)).filter_map(height).collect();
        let [low, high] = [f32::min, f32::max].map(|of| teeth.iter().copied().reduce(of).unwrap());
        assert!(high - low < 0.1, "{low} to {high}");
        assert!((19.4..19.6).contains(&((low + high) / 2.0)), "{low} to {high}");
        let inside = (0..whole.len())
            .filter(|&v| is_near(v, 1.0, 18.0) && (1.0..=19.0).contains(&whole[v].x));
        assert!(inside.clone().count() > 300);
        assert!(inside.into_iter().all(|v| mesh.positions[v] == whole[v]));
    }

    #[test]
    fn a_vertex_where_borders_touch_stays() {
        let mut mesh = sheet(20, &[(9, 9), (10, 10)]);
        let touching = mesh.positions.iter().position(|at| *at == Vec3::new(10.0, 10.0, 1.0));
        smooth_border(&mut mesh);
        assert_eq!(mesh.positions[touching.unwrap()], Vec3::new(10.0, 10.0, 1.0));
    }
}
