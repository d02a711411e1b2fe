//! Which sheets of the surface run through a cell.
//!
//! One vertex for all of them would join sheets that only pass near each other: edges with four faces, which nothing can simplify or
//! unwrap. So each sheet has a vertex of its own (Nielson 2004, dual marching cubes).

/// The corners of a cell, bit i of the number along axis i.
pub(super) const CORNERS: usize = 8;
/// The edges of a cell, by their corners: four along each axis.
pub(super) const EDGES: [(usize, usize); 12] =
    [(0, 1), (2, 3), (4, 5), (6, 7), (0, 2), (1, 3), (4, 6), (5, 7), (0, 4), (1, 5), (2, 6), (3, 7)];

/// Edges of a cell, a bit for each.
pub(super) type EdgeSet = u16;

/// The number of the edge along `axis` that begins at corner `from`.
pub(super) fn edge(from: usize, axis: usize) -> usize {
    let [low, high] = [[1, 2], [0, 2], [0, 1]][axis];
    4 * axis + (from >> low & 1) + 2 * (from >> high & 1)
}

/// The edges that each sheet crosses, in the order of its first edge; signs of distances at the corners decide.
pub(super) fn sheets(distances: &[f32; CORNERS]) -> impl Iterator<Item = EdgeSet> + use<> {
    let inside = distances.map(|d| d < 0.0);
    let crossed = |e: usize| inside[EDGES[e].0] != inside[EDGES[e].1];
    // Each begins as a sheet of its own.
    let mut sheet: [EdgeSet; 12] = std::array::from_fn(|e| EdgeSet::from(crossed(e)) << e);
    let mut join = |a: usize, b: usize| {
        let both = sheet[a] | sheet[b];
        (0..12).filter(|e| both >> e & 1 == 1).for_each(|e| sheet[e] = both);
    };
    for face in 0..6 {
        let ring = ring(face);
        let edges: [usize; 4] = std::array::from_fn(|k| between(ring[k], ring[(k + 1) % 4]));
        match edges.iter().filter(|e| crossed(**e)).count() {
            0 => {}
            4 => {
                // Corners of two signs, crosswise: those of the lesser weight are apart. Both cells of a face add in this order.
                let [a, b, c, d] = ring.map(|corner| distances[corner]);
                let apart = (a + c) + (b + d) >= 0.0;
                (0..4).filter(|k| inside[ring[*k]] == apart).for_each(|k| join(edges[(k + 3) % 4], edges[k]));
            }
            _ => {
                let mut two = edges.into_iter().filter(|e| crossed(*e));
                if let (Some(a), Some(b)) = (two.next(), two.next()) {
                    join(a, b);
                }
            }
        }
    }
    (0..12).filter(move |e| sheet[*e] != 0 && sheet[*e].trailing_zeros() == *e as u32).map(move |e| sheet[e])
}

/// The corners around a face: two for each axis, the lower one first. Opposite faces have them in the same order.
fn ring(face: usize) -> [usize; 4] {
    let (axis, high) = (face / 2, face % 2);
    let [b, c] = [1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3)];
    [0, b, b | c, c].map(|corner| corner | high << axis)
}

/// The number of the edge between two corners beside each other.
fn between(a: usize, b: usize) -> usize {
    edge(a.min(b), (a ^ b).trailing_zeros() as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(inside: &[usize], weight: f32) -> Vec<EdgeSet> {
        let mut distances = [1.0; CORNERS];
        inside.iter().for_each(|corner| distances[*corner] = -weight);
        sheets(&distances).collect()
    }

    #[test]
    fn edges_are_where_their_corners_say() {
        for (number, (a, b)) in EDGES.into_iter().enumerate() {
            assert_eq!(between(a, b), number);
        }
    }

    #[test]
    fn opposite_corners_have_a_sheet_each() {
        assert_eq!(of(&[], 1.0).len(), 0);
        assert_eq!(of(&[0], 1.0), [1 | 1 << 4 | 1 << 8]);
        assert_eq!(of(&[0, 7], 1.0).len(), 2);
        assert_eq!(of(&[0, 1], 1.0).len(), 1, "an edge");
        // On a face the heavier pair is joined.
        assert_eq!([0.5, 2.0].map(|weight| of(&[0, 3], weight).len()), [2, 1]);
    }

    #[test]
    fn every_crossed_edge_is_in_one_sheet_of_three_edges_or_more() {
        for signs in 0..256usize {
            let distances: [f32; CORNERS] =
                std::array::from_fn(|i| if signs >> i & 1 == 1 { -1.0 } else { 1.0 });
            let crossed = |e: &usize| (distances[EDGES[*e].0] < 0.0) != (distances[EDGES[*e].1] < 0.0);
            let all = (0..12).filter(crossed).fold(0, |set: EdgeSet, e| set | 1 << e);
            let found: Vec<EdgeSet> = sheets(&distances).collect();
            assert_eq!(found.iter().fold(0, |a, b| a | b), all, "{signs:08b}");
            assert_eq!(found.iter().map(|s| s.count_ones()).sum::<u32>(), all.count_ones(), "{signs:08b}");
            assert!(found.iter().all(|sheet| sheet.count_ones() >= 3), "{signs:08b}");
        }
    }
}
