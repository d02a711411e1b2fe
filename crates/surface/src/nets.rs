//! Surface nets (Gibson 1998): a vertex for every sheet of the surface in a cell, a quadrilateral
//! across every edge of the lattice that it crosses. Cells with an unobserved corner have none.

use crate::fuse::DistanceField;
use crate::grid::{Grid, SAMPLES, SIDE, block, offset_of};
use glam::{IVec3, Vec3};
use std::ops::Range;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::parallel;

/// Crossings stay this far from the samples, as a share of the edge, so that no two vertices fall
/// together.
const INSET: f32 = 1e-3;
const AXES: [IVec3; 3] = [IVec3::X, IVec3::Y, IVec3::Z];

/// The vertices of one block.
#[derive(Default)]
struct BlockVertices {
    /// Number of the first.
    first: u32,
    /// Their cells, ascending, ...
    cells: Vec<u16>,
    /// ... and the edges of these that their sheets cross.
    edges: Vec<EdgeSet>,
    positions: Vec<Vec3>,
    colors: Vec<[f32; 3]>,
    /// Whether a distance around it was extended.
    extended: Vec<bool>,
}

/// The zero of `field` as a connected mesh with a colour per vertex, whose fronts face what is free;
/// and the vertices that were not observed: a distance around them was extended.
pub(super) fn nets(field: &DistanceField, grid: &Grid) -> (Mesh, Vec<bool>) {
    let mut blocks = parallel::collect(field.blocks.len(), 1, |i| block_vertices(field, grid, i));
    let mut count = 0;
    for block in &mut blocks {
        block.first = count;
        count += block.cells.len() as u32;
    }
    let faces = |range: Range<usize>| {
        range.flat_map(|i| block_faces(field, &blocks, i)).collect::<Vec<u32>>()
    };
    let indices = parallel::ranges(blocks.len(), 1, faces).concat();
    let positions = blocks.iter().flat_map(|block| block.positions.iter().copied()).collect();
    let colors =
        Colors::Vertex(blocks.iter().flat_map(|block| block.colors.iter().copied()).collect());
    let extended = blocks.iter().flat_map(|block| block.extended.iter().copied()).collect();
    (Mesh { positions, colors, indices, ..Mesh::default() }, extended)
}

fn corner(i: usize) -> IVec3 {
    IVec3::new(i as i32 & 1, i as i32 >> 1 & 1, i as i32 >> 2)
}

/// Distances at the corners of a cell; `None` when one is not known or the surface is not in it.
fn corners(
    field: &DistanceField,
    index: usize,
    cell: IVec3,
    local: usize,
) -> Option<[f32; CORNERS]> {
    let inner = offset_of(local).max_element() < SIDE - 1;
    let distance = |i: usize| {
        if inner {
            let step = corner(i).dot(IVec3::new(1, SIDE, SIDE * SIDE));
            field.blocks[index].distance[local + step as usize]
        } else {
            field.distance(cell + corner(i))
        }
    };
    let first = distance(0);
    if first.is_nan() {
        return None;
    }
    let all: [f32; CORNERS] = std::array::from_fn(distance);
    let mixed = all.iter().any(|d| (*d < 0.0) != (first < 0.0));
    (mixed && all.iter().all(|d| !d.is_nan())).then_some(all)
}

fn block_vertices(field: &DistanceField, grid: &Grid, index: usize) -> BlockVertices {
    let first = block(field.numbers[index]) * SIDE;
    let mut out = BlockVertices::default();
    for local in 0..SAMPLES {
        let cell = first + offset_of(local);
        let Some(distances) = corners(field, index, cell, local) else { continue };
        let is_extended = (0..CORNERS).any(|i| field.is_extended(cell + corner(i)));
        for crossed in sheets(&distances) {
            let mut middle = Vec3::ZERO;
            let mut color = Vec3::ZERO;
            for (a, b) in (0..EDGES.len()).filter(|e| crossed >> e & 1 == 1).map(|e| EDGES[e]) {
                let from = distances[a];
                let to = distances[b];
                let share = (from / (from - to)).clamp(INSET, 1.0 - INSET);
                middle += corner(a).as_vec3().lerp(corner(b).as_vec3(), share);
                color += field.color(cell + corner(a)).lerp(field.color(cell + corner(b)), share);
            }
            let crossings = crossed.count_ones() as f32;
            out.cells.push(local as u16);
            out.extended.push(is_extended);
            out.edges.push(crossed);
            out.positions.push(grid.sample(cell) + middle / crossings * grid.voxel);
            out.colors.push((color / crossings).clamp(Vec3::ZERO, Vec3::ONE).to_array());
        }
    }
    out
}

/// Corners of the triangles across the edges that start at the samples of a block.
fn block_faces(field: &DistanceField, blocks: &[BlockVertices], index: usize) -> Vec<u32> {
    let first = block(field.numbers[index]) * SIDE;
    // The vertex of the sheet that crosses the edge from `sample` along `axis`.
    let vertex = |cell: IVec3, sample: IVec3, axis: usize| -> Option<(u32, Vec3)> {
        let (block, local) = field.find(cell)?;
        let block = &blocks[block];
        let edge = edge((sample - cell).dot(IVec3::new(1, 2, 4)) as usize, axis);
        let from = block.cells.partition_point(|other| usize::from(*other) < local);
        let of_cell =
            (from..block.cells.len()).take_while(|i| usize::from(block.cells[*i]) == local);
        let at = of_cell.into_iter().find(|i| block.edges[*i] >> edge & 1 == 1)?;
        Some((block.first + at as u32, block.positions[at]))
    };
    let mut indices = Vec::new();
    for local in 0..SAMPLES {
        let sample = first + offset_of(local);
        let from = field.blocks[index].distance[local];
        if from.is_nan() {
            continue;
        }
        for axis in 0..3 {
            let to = field.distance(sample + AXES[axis]);
            if to.is_nan() || (from < 0.0) == (to < 0.0) {
                continue;
            }
            let b = AXES[(axis + 1) % 3];
            let c = AXES[(axis + 2) % 3];
            // The four cells around the edge, counter-clockwise as seen from its end.
            let around = [sample - b - c, sample - c, sample, sample - b];
            let around = around.map(|cell| vertex(cell, sample, axis));
            let [Some(p), Some(q), Some(r), Some(s)] = around else { continue };
            let ring = if from < 0.0 { [p, q, r, s] } else { [p, s, r, q] };
            indices.extend(triangulate(ring));
        }
    }
    indices
}

/// Cuts a quadrilateral along its shorter diagonal.
fn triangulate(ring: [(u32, Vec3); 4]) -> [u32; 6] {
    let [a, b, c, d] = ring.map(|(number, _)| number);
    let length = |i: usize, j: usize| ring[i].1.distance_squared(ring[j].1);
    if length(0, 2) <= length(1, 3) { [a, b, c, a, c, d] } else { [a, b, d, b, c, d] }
}

// ---- Which sheets of the surface run through a cell ---------------------------------------------

/// The corners of a cell, bit i of the number along axis i.
pub(super) const CORNERS: usize = 8;
/// The edges of a cell, by their corners: four along each axis.
pub(super) const EDGES: [(usize, usize); 12] = [
    (0, 1),
    (2, 3),
    (4, 5),
    (6, 7),
    (0, 2),
    (1, 3),
    (4, 6),
    (5, 7),
    (0, 4),
    (1, 5),
    (2, 6),
    (3, 7),
];

/// Edges of a cell, a bit for each.
pub(super) type EdgeSet = u16;

/// The number of the edge along `axis` that begins at corner `from`.
pub(super) fn edge(from: usize, axis: usize) -> usize {
    let [low, high] = [[1, 2], [0, 2], [0, 1]][axis];
    4 * axis + (from >> low & 1) + 2 * (from >> high & 1)
}

/// The edges that each sheet crosses, in the order of its first edge; signs of distances at the
/// corners decide.
pub(super) fn sheets(distances: &[f32; CORNERS]) -> impl Iterator<Item = EdgeSet> + use<> {
    let inside = distances.map(|d| d < 0.0);
    let crossed = |e: usize| inside[EDGES[e].0] != inside[EDGES[e].1];
    // Each begins as a sheet of its own.
    let mut sheet: [EdgeSet; 12] = std::array::from_fn(|e| EdgeSet::from(crossed(e)) << e);
    let mut join = |a: usize, b: usize| {
        let both = sheet[a] | sheet[b];
        for e in (0..12).filter(|e| both >> e & 1 == 1) {
            sheet[e] = both;
        }
    };
    for face in 0..6 {
        let ring = ring(face);
        let edges: [usize; 4] = std::array::from_fn(|k| between(ring[k], ring[(k + 1) % 4]));
        match edges.iter().filter(|e| crossed(**e)).count() {
            0 => {}
            4 => {
                // Corners of two signs, crosswise: those of the lesser weight are apart. Both cells
                // of a face add in this order.
                let [a, b, c, d] = ring.map(|corner| distances[corner]);
                let separate_sign = (a + c) + (b + d) >= 0.0;
                for k in (0..4).filter(|k| inside[ring[*k]] == separate_sign) {
                    join(edges[(k + 3) % 4], edges[k]);
                }
            }
            _ => {
                let mut two = edges.into_iter().filter(|e| crossed(*e));
                if let (Some(a), Some(b)) = (two.next(), two.next()) {
                    join(a, b);
                }
            }
        }
    }
    (0..12)
        .filter(move |e| sheet[*e] != 0 && sheet[*e].trailing_zeros() == *e as u32)
        .map(move |e| sheet[e])
}

/// The corners around a face: two for each axis, the lower one first. Opposite faces have them in
/// the same order.
fn ring(face: usize) -> [usize; 4] {
    let axis = face / 2;
    let high = face % 2;
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
        for corner in inside {
            distances[*corner] = -weight;
        }
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
            let crossed =
                |e: &usize| (distances[EDGES[*e].0] < 0.0) != (distances[EDGES[*e].1] < 0.0);
            let all = (0..12).filter(crossed).fold(0, |set: EdgeSet, e| set | 1 << e);
            let cell_sheets: Vec<EdgeSet> = sheets(&distances).collect();
            assert_eq!(cell_sheets.iter().fold(0, |a, b| a | b), all, "{signs:08b}");
            assert_eq!(
                cell_sheets.iter().map(|s| s.count_ones()).sum::<u32>(),
                all.count_ones(),
                "{signs:08b}"
            );
            assert!(cell_sheets.iter().all(|sheet| sheet.count_ones() >= 3), "{signs:08b}");
        }
    }
}
