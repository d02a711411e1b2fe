//! Closes small holes: where photos see too little of a wall, the field has no distance, and the surface a hole.

use glam::Vec3;
use std::collections::BTreeMap;
use trisplat_scene::mesh::{Colors, Mesh};

/// Holes with more edges are not small.
const MOST_EDGES: usize = 32;

/// Which holes are closed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Holes {
    /// Those with few edges.
    Small,
    /// All but the one that reaches farthest, which is the outline: one of zigzags may have more edges.
    AllButTheWidest,
}

/// Closes `holes`, each by a fan around its middle. Returns how many. The mesh has indices and a colour per vertex.
pub(super) fn fill(mesh: &mut Mesh, holes: Holes) -> u64 {
    let mut rings = rings(mesh);
    match holes {
        Holes::Small => rings.retain(|ring| ring.len() <= MOST_EDGES),
        Holes::AllButTheWidest => {
            let reach: Vec<f32> = rings.iter().map(|ring| reach(mesh, ring)).collect();
            let widest = (0..rings.len()).max_by(|a, b| reach[*a].total_cmp(&reach[*b]).then(b.cmp(a)));
            if let Some(outline) = widest {
                rings.remove(outline);
            }
        }
    }
    rings.iter().for_each(|ring| close(mesh, ring));
    rings.len() as u64
}

/// The vertices of each hole, in order around it. Where borders touch at a vertex, each gets a ring of its own that passes there.
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
                ring.iter().for_each(|vertex| places[*vertex as usize] = None);
                rings.extend(Some(ring).filter(|ring| ring.len() >= 3));
            }
            places[next as usize] = Some(path.len());
            path.push(next);
        }
        // A border that ends nowhere is no ring.
        path.iter().for_each(|vertex| places[*vertex as usize] = None);
    }
    rings
}

/// Takes one of the vertices after `at` from the borders.
fn take(after: &mut BTreeMap<u32, Vec<u32>>, at: u32) -> Option<u32> {
    let next = after.get_mut(&at)?;
    let taken = next.pop();
    if next.is_empty() {
        after.remove(&at);
    }
    taken
}

/// The vertices after each of the border, along the holes: several where borders touch.
fn border(mesh: &Mesh) -> BTreeMap<u32, Vec<u32>> {
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
    let (position, color) = (mean(&|v| mesh.positions[v]), mean(&|v| Vec3::from(colors[v])));
    mesh.positions.push(position);
    colors.push(color.to_array());
    for (i, vertex) in ring.iter().enumerate() {
        mesh.indices.extend([*vertex, ring[(i + 1) % ring.len()], middle]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A sheet of cells, some left out.
    fn sheet(side: u32, without: &[(u32, u32)]) -> Mesh {
        let at = |x: u32, y: u32| y * (side + 1) + x;
        let mut mesh = Mesh::default();
        for y in 0..=side {
            for x in 0..=side {
                mesh.positions.push(Vec3::new(x as f32, y as f32, 1.0));
            }
        }
        mesh.colors = Colors::Vertex(vec![[0.5; 3]; mesh.positions.len()]);
        for (x, y) in
            (0..side).flat_map(|y| (0..side).map(move |x| (x, y))).filter(|cell| !without.contains(cell))
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
        let (middle, wants) = (Vec3::from(*colors.last().unwrap()), Vec3::new(7.0, 0.0, 9.0) / 16.0);
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
