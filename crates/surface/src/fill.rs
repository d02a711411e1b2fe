//! Closes small holes: where photos see too little of a wall, the field has no distance, and the
//! surface a hole.

use glam::Vec3;
use std::collections::BTreeMap;
use trisplat_scene::math::lists::Sets;
use trisplat_scene::mesh::{Colors, Mesh};

/// Holes with more edges are not small.
const MAX_EDGES: usize = 32;

/// Choice of holes to close.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Holes {
    /// Holes with at most [`MAX_EDGES`] edges.
    Small,
    /// All but the one that reaches farthest, which is the outline: one of zigzags may have more
    /// edges.
    AllButTheWidest,
}

/// Closes `holes`, each by a fan around its middle. Returns how many. The mesh has indices and a
/// colour per vertex.
pub(super) fn fill(mesh: &mut Mesh, holes: Holes) -> u64 {
    let mut rings = rings(mesh);
    match holes {
        Holes::Small => rings.retain(|ring| ring.len() <= MAX_EDGES),
        Holes::AllButTheWidest => {
            let reach: Vec<f32> = rings.iter().map(|ring| reach(mesh, ring)).collect();
            let widest =
                (0..rings.len()).max_by(|a, b| reach[*a].total_cmp(&reach[*b]).then(b.cmp(a)));
            if let Some(outline) = widest {
                rings.remove(outline);
            }
        }
    }
    for ring in &rings {
        close(mesh, ring);
    }
    rings.len() as u64
}

/// The vertices of each hole, in order around it. Where borders touch at a vertex, each gets a ring
/// of its own that passes there.
fn rings(mesh: &Mesh) -> Vec<Vec<u32>> {
    let mut after = border(mesh);
    let mut places: Vec<Option<usize>> = vec![None; mesh.vertex_count()];
    let mut rings = Vec::new();
    while let Some(start) = after.keys().next().copied() {
        let mut path = vec![start];
        places[start as usize] = Some(0);
        while let Some(next) = path.last().and_then(|at| take(&mut after, *at)) {
            if let Some(first) = places[next as usize] {
                let ring = path.split_off(first);
                for vertex in &ring {
                    places[*vertex as usize] = None;
                }
                rings.extend(Some(ring).filter(|ring| ring.len() >= 3));
            }
            places[next as usize] = Some(path.len());
            path.push(next);
        }
        // A border that ends nowhere is no ring.
        for vertex in path {
            places[vertex as usize] = None;
        }
    }
    rings
}

/// Takes one of the vertices after `at` from the borders.
fn take(after: &mut BTreeMap<u32, Vec<u32>>, at: u32) -> Option<u32> {
    let next = after.get_mut(&at)?;
    let vertex = next.pop();
    if next.is_empty() {
        after.remove(&at);
    }
    vertex
}

/// The vertices after each of the border, along the holes: several where borders touch.
pub(super) fn border(mesh: &Mesh) -> BTreeMap<u32, Vec<u32>> {
    let edges = |[a, b, c]: [u32; 3]| [(a, b), (b, c), (c, a)];
    let mut sides: Vec<(u32, u32)> =
        mesh.indices.as_chunks::<3>().0.iter().copied().flat_map(edges).collect();
    sides.sort_unstable();
    let mut after: BTreeMap<u32, Vec<u32>> = BTreeMap::new();
    for &(a, b) in sides.iter().filter(|(a, b)| sides.binary_search(&(*b, *a)).is_err()) {
        after.entry(b).or_default().push(a);
    }
    after
}

/// The largest distance of a ring from its middle.
fn reach(mesh: &Mesh, ring: &[u32]) -> f32 {
    let at = |vertex: &u32| mesh.positions[*vertex as usize];
    let middle = ring.iter().map(at).sum::<Vec3>() / ring.len() as f32;
    ring.iter().map(|vertex| at(vertex).distance(middle)).fold(0.0, f32::max)
}

fn close(mesh: &mut Mesh, ring: &[u32]) {
    let Colors::Vertex(colors) = &mut mesh.colors else { return };
    let middle = mesh.positions.len() as u32;
    let mean = |of: &dyn Fn(usize) -> Vec3| {
        ring.iter().map(|vertex| of(*vertex as usize)).sum::<Vec3>() / ring.len() as f32
    };
    let position = mean(&|v| mesh.positions[v]);
    let color = mean(&|v| Vec3::from(colors[v]));
    mesh.positions.push(position);
    colors.push(color.to_array());
    for (i, vertex) in ring.iter().enumerate() {
        mesh.indices.extend([*vertex, ring[(i + 1) % ring.len()], middle]);
    }
}

// ---- Connected pieces of a mesh -----------------------------------------------------------------

/// Result of [`drop_small`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Components {
    /// Number of pieces that are left.
    pub(super) remaining: u64,
    /// Faces of the others.
    pub(super) dropped_faces: u64,
}

/// Drops pieces of fewer than `min_faces` faces, and vertices that no face uses. Faces are
/// connected that share a vertex.
pub(super) fn drop_small(mesh: &mut Mesh, min_faces: u32) -> Components {
    let pieces = pieces(mesh);
    let mut faces = vec![0u32; mesh.vertex_count()];
    for piece in &pieces {
        faces[*piece as usize] += 1;
    }
    keep_pieces(mesh, &pieces, |piece| faces[piece] > 0 && faces[piece] >= min_faces)
}

/// Drops pieces with less than `share` of the area of all; the largest stays.
pub(super) fn drop_small_areas(mesh: &mut Mesh, share: f64) -> Components {
    let pieces = pieces(mesh);
    let mut areas = vec![0.0; mesh.vertex_count()];
    for (face, piece) in pieces.iter().enumerate() {
        areas[*piece as usize] += mesh.area(face);
    }
    let all = areas.iter().sum::<f64>();
    let largest = areas.iter().copied().fold(0.0, f64::max);
    let min_area = f64::min(share * all, largest);
    keep_pieces(mesh, &pieces, |piece| areas[piece] > 0.0 && areas[piece] >= min_area)
}

/// The first vertex of the piece that each face is in. `[F]`
fn pieces(mesh: &Mesh) -> Vec<u32> {
    let mut sets = Sets::new(mesh.vertex_count());
    for [a, b, c] in (0..mesh.face_count()).map(|face| mesh.face(face)) {
        sets.join(a, b);
        sets.join(b, c);
    }
    (0..mesh.face_count()).map(|face| sets.first(mesh.face(face)[0])).collect()
}

/// Keeps some of the pieces, each named by its first vertex.
fn keep_pieces(mesh: &mut Mesh, pieces: &[u32], stays: impl Fn(usize) -> bool) -> Components {
    let before = mesh.face_count();
    let remaining = (0..mesh.vertex_count()).filter(|piece| stays(*piece)).count() as u64;
    mesh.retain(|face| stays(pieces[face] as usize));
    Components { remaining, dropped_faces: (before - mesh.face_count()) as u64 }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A sheet of cells, some left out.
    pub(crate) fn sheet(side: u32, without: &[(u32, u32)]) -> Mesh {
        let at = |x: u32, y: u32| y * (side + 1) + x;
        let mut mesh = Mesh::default();
        for y in 0..=side {
            for x in 0..=side {
                mesh.positions.push(Vec3::new(x as f32, y as f32, 1.0));
            }
        }
        mesh.colors = Colors::Vertex(vec![[0.5; 3]; mesh.positions.len()]);
        for (x, y) in (0..side)
            .flat_map(|y| (0..side).map(move |x| (x, y)))
            .filter(|cell| !without.contains(cell))
        {
            let [a, b, c, d] = [at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
            mesh.indices.extend([a, b, c, a, c, d]);
        }
        mesh
    }

    #[test]
    fn small_holes_are_closed_and_the_outline_is_not() {
        let mut mesh = sheet(20, &[(4, 4), (9, 9), (10, 9)]);
        assert_eq!(fill(&mut mesh, Holes::Small), 2);
        let area = |mesh: &Mesh| (0..mesh.face_count()).map(|f| mesh.area(f)).sum::<f64>();
        assert!((area(&mesh) - 400.0).abs() < 1e-6, "{}", area(&mesh));
        assert!(
            (0..mesh.face_count()).all(|face| mesh.flat_normal(face).z > 0.99),
            "they face as those around them"
        );
        assert_eq!(fill(&mut mesh, Holes::Small), 0, "the outline has 80 edges");
    }

    #[test]
    fn holes_that_touch_at_a_corner_are_closed_each() {
        // Two beside each other, and one at the corner of the sheet's outline.
        let mut mesh = sheet(20, &[(4, 4), (5, 5), (0, 0), (1, 1)]);
        assert_eq!(fill(&mut mesh, Holes::AllButTheWidest), 3);
        let area = (0..mesh.face_count()).map(|face| mesh.area(face)).sum::<f64>();
        assert!((area - 399.0).abs() < 1e-6, "{area}: all but the corner that was never there");
        assert_eq!(fill(&mut mesh, Holes::AllButTheWidest), 0);
    }

    #[test]
    fn a_hole_of_zigzags_is_no_outline() {
        // A comb: its ring has more edges than the 80 of the outline.
        let teeth = (1..10).flat_map(|x| (3..17).map(move |y| (2 * x, y)));
        let comb: Vec<(u32, u32)> = teeth.chain((2..19).map(|x| (x, 2))).collect();
        let mut mesh = sheet(20, &comb);
        assert!(rings(&mesh).iter().any(|ring| ring.len() > 200));
        assert_eq!(fill(&mut mesh, Holes::AllButTheWidest), 1);
        assert_eq!(rings(&mesh).iter().map(Vec::len).collect::<Vec<_>>(), [80]);
    }

    #[test]
    fn the_middle_has_the_mean_colour_of_the_ring() {
        // Red on the left, blue from the middle of the hole on: 2 of 5 columns of its ring are red.
        let hole: Vec<(u32, u32)> = (8..12).flat_map(|y| (8..12).map(move |x| (x, y))).collect();
        let mut mesh = sheet(20, &hole);
        let of_column = |at: &Vec3| if at.x < 9.5 { [1.0, 0.0, 0.0] } else { [0.0, 0.0, 1.0] };
        mesh.colors = Colors::Vertex(mesh.positions.iter().map(of_column).collect());
        assert_eq!(fill(&mut mesh, Holes::Small), 1);
        // A ring of 16: the left side has 5, the column beside it its two ends.
        let Colors::Vertex(colors) = &mesh.colors else { panic!("a colour per vertex") };
        let middle = Vec3::from(*colors.last().unwrap());
        let wants = Vec3::new(7.0, 0.0, 9.0) / 16.0;
        assert!(middle.distance(wants) < 1e-5, "{middle}");
        assert_eq!(*mesh.positions.last().unwrap(), Vec3::new(10.0, 10.0, 1.0));
    }

    #[test]
    fn a_large_hole_stays_open() {
        let hole: Vec<(u32, u32)> = (5..15).flat_map(|y| (5..15).map(move |x| (x, y))).collect();
        let mut mesh = sheet(20, &hole);
        assert_eq!(fill(&mut mesh, Holes::Small), 0, "40 edges");
        assert_eq!(fill(&mut mesh, Holes::AllButTheWidest), 1, "the outline has 80");
        assert_eq!(fill(&mut mesh, Holes::AllButTheWidest), 0);
    }
}

#[cfg(test)]
mod components_tests {
    use super::*;
    use glam::Vec3;
    use trisplat_scene::mesh::Colors;

    #[test]
    fn small_pieces_go_and_large_ones_stay() {
        // A strip of four faces, out of order, and a single one.
        let mut mesh = Mesh {
            positions: (0..9).map(|i| Vec3::splat(i as f32)).collect(),
            colors: Colors::Vertex(vec![[0.5; 3]; 9]),
            indices: vec![3, 4, 5, 0, 1, 2, 6, 7, 8, 2, 3, 4, 1, 2, 3],
            opacity: Vec::new(),
            ..Mesh::default()
        };
        let wants = Components { remaining: 1, dropped_faces: 1 };
        assert_eq!(drop_small(&mut mesh, 2), wants);
        assert_eq!((mesh.face_count(), mesh.vertex_count()), (4, 6));
        assert_eq!(drop_small(&mut mesh, 5), Components { remaining: 0, dropped_faces: 4 });
        assert_eq!((mesh.face_count(), mesh.vertex_count()), (0, 0));
    }

    #[test]
    fn pieces_of_little_area_go_and_the_largest_stays() {
        // Right triangles at distance, with legs 1, 2 and 3: areas 0.5, 2 and 4.5.
        let triangle =
            |side: f32| [Vec3::ZERO, Vec3::X * side, Vec3::Y * side].map(|p| p + Vec3::Z * side);
        let mut mesh = Mesh {
            positions: [1.0, 2.0, 3.0].into_iter().flat_map(triangle).collect(),
            colors: Colors::Vertex(vec![[0.5; 3]; 9]),
            indices: (0..9).collect(),
            ..Mesh::default()
        };
        assert_eq!(drop_small_areas(&mut mesh, 0.1), Components { remaining: 2, dropped_faces: 1 });
        assert_eq!(
            drop_small_areas(&mut mesh, 0.99),
            Components { remaining: 1, dropped_faces: 1 }
        );
        assert_eq!(mesh.area(0), 4.5);
    }
}
