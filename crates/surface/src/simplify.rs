//! Fewer triangles for the same surface: pieces too small for what is left go, edges collapse by the quadric errors of meshoptimizer,
//! and where the topology permits no more of that, vertices are joined and edges collapse again.

use super::cluster::{cluster, drop_unused};
use super::components::{Components, drop_small_areas};
use glam::Vec3;
use meshopt::{SimplifyOptions, VertexDataAdapter};
use trisplat_scene::{
    Error, Result,
    math::color::srgb_from_linear,
    mesh::{Colors, Mesh},
};

/// How much a change of colour counts: one from black to white as a move by this share of the mesh's size.
const COLOR_WEIGHT: f32 = 0.02;
/// A piece whose share of the area is worth fewer triangles is dropped: an octahedron has as many.
const LEAST_PER_PIECE: f64 = 8.0;
/// Most triangles that edge collapses start from, per triangle that stays: their time has no other bound.
const MOST_PER_KEPT: usize = 512;
/// Side of the first cells in which vertices are joined, in the length of the mean edge.
const FIRST_CELL: f32 = 2.0;
/// How much larger cells are in the next round.
const NEXT_CELL: f32 = 1.5;

/// Edge collapses that leave less of the surface's extent along an axis are not used.
const LEAST_SIZE: f32 = 0.5;

/// What simplification did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Simplified {
    /// How far the surface moved, units of the mesh, as it estimates it.
    pub(super) error: f64,
    /// What became of pieces too small for the triangles that were left.
    pub(super) pieces: Components,
}

/// Simplifies an indexed mesh with colours per vertex to at most `most` faces; `None` when it had no more already.
///
/// Errors: a surface that so few triangles cannot show.
pub(super) fn simplify(mesh: &mut Mesh, most: usize) -> Result<Option<Simplified>> {
    if mesh.face_count() <= most {
        return Ok(None);
    }
    let pieces = drop_small_areas(mesh, LEAST_PER_PIECE / most as f64);
    let mut side = FIRST_CELL * mean_edge(mesh);
    let whole = size(mesh);
    let mut error = 0.0;
    while mesh.face_count() > most.saturating_mul(MOST_PER_KEPT) {
        (error, side) = (error + cluster(mesh, side), side * NEXT_CELL);
    }
    let mut fewest = mesh.face_count();
    while mesh.face_count() > most {
        let mut collapsed = mesh.clone();
        let moved = collapse(&mut collapsed, most);
        // Collapses may end with nothing or with a corner of it, too; then the vertices are joined that there were.
        if size(&collapsed).cmpge(LEAST_SIZE * whole).all() && collapsed.face_count() > 0 {
            (*mesh, error) = (collapsed, error + moved);
        }
        if mesh.face_count() > most {
            fewest = mesh.face_count();
            (error, side) = (error + cluster(mesh, side), side * NEXT_CELL);
        }
    }
    match check(mesh, most) {
        true => Ok(Some(Simplified { error, pieces })),
        false => {
            let wants = format!("more: of this surface {fewest} triangles are left, and with fewer nothing");
            Err(Error::invalid("max_triangles", most, wants))
        }
    }
}

/// Collapses edges until `most` faces are left, or the topology permits no more. Returns how far the surface moved.
fn collapse(mesh: &mut Mesh, most: usize) -> f64 {
    let Colors::Vertex(colors) = &mesh.colors else { return 0.0 };
    let codes: Vec<f32> = colors.iter().flatten().map(|channel| srgb_from_linear(*channel)).collect();
    let bytes: &[u8] = bytemuck::cast_slice(&mesh.positions);
    let Ok(vertices) = VertexDataAdapter::new(bytes, size_of::<Vec3>(), 0) else { return 0.0 };
    let scale = meshopt::simplify_scale(&vertices);
    let mut error = 0.0;
    // No vertex is locked. An empty list would be read beyond its end.
    // Not `Prune`: where the topology keeps a piece above `most`, it drops one piece after the other until none is left.
    mesh.indices = meshopt::simplify_with_attributes_and_locks(
        &mesh.indices,
        &vertices,
        &codes,
        &[COLOR_WEIGHT; 3],
        3 * size_of::<f32>(),
        &vec![false; mesh.vertex_count()],
        3 * most,
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

/// True of an indexed mesh of 1 to `most` faces of three vertices each.
fn check(mesh: &Mesh, most: usize) -> bool {
    let whole = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
    (1..=most).contains(&mesh.face_count())
        && mesh.indices.len() == 3 * mesh.face_count()
        && mesh.indices.as_chunks::<3>().0.iter().all(whole)
        && mesh.validate().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::IVec3;
    use std::collections::HashMap;

    /// Every other cube of a block of n³: all their edges are shared by four faces, so that no edge may collapse.
    fn checkerboard(n: i32) -> Mesh {
        let (mut mesh, mut numbers) =
            (Mesh { colors: Colors::Vertex(Vec::new()), ..Mesh::default() }, HashMap::new());
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
                    let [p, q, r, s] =
                        [IVec3::ZERO, b, b + c, c].map(|corner| vertex(&mut mesh, cube + side + corner));
                    mesh.indices.extend([p, q, r, p, r, s]);
                }
            }
        }
        mesh
    }

    /// A closed ball of 8 · 4^levels triangles around `center`.
    fn ball(center: Vec3, radius: f32, levels: u32) -> Mesh {
        let (corners, faces) = trisplat_scene::math::octasphere::octasphere(levels);
        Mesh {
            colors: Colors::Vertex(vec![[0.5; 3]; corners.len()]),
            positions: corners.into_iter().map(|c| center + radius * c).collect(),
            indices: faces.into_flattened(),
            ..Mesh::default()
        }
    }

    fn simplified(mesh: &Mesh, most: usize) -> Result<Mesh> {
        let mut mesh = mesh.clone();
        let details = simplify(&mut mesh, most)?.expect("there is something to do");
        assert!(details.error.is_finite() && check(&mesh, most), "{most}: {details:?}");
        Ok(mesh)
    }

    #[test]
    fn what_edge_collapses_would_empty_ends_within_its_budget() {
        let mesh = checkerboard(12);
        assert_eq!(mesh.face_count(), 864 * 12);
        let bytes: &[u8] = bytemuck::cast_slice(&mesh.positions);
        let vertices = VertexDataAdapter::new(bytes, size_of::<Vec3>(), 0).unwrap();
        let with = |how| meshopt::simplify(&mesh.indices, &vertices, 3 * 50, f32::MAX, how, None).len();
        assert_eq!([SimplifyOptions::Prune, SimplifyOptions::None].map(with), [0, 0], "the hard case");
        for most in [2000, 400, 100, 50] {
            let simple = simplified(&mesh, most).unwrap();
            assert!(size(&simple).cmpge(0.5 * size(&mesh)).all(), "{most}: {}", size(&simple));
        }
    }

    #[test]
    fn too_few_triangles_are_an_error_and_not_a_wrong_file() {
        let mut enough = 0;
        for most in 1..40 {
            match simplified(&checkerboard(4), most) {
                Ok(_) => enough += 1,
                Err(error) => assert!(error.to_string().starts_with("max_triangles is"), "{error}"),
            }
        }
        assert!(enough > 20, "{enough}");
        let error =
            simplified(&ball(Vec3::ZERO, 1.0, 4), 1).expect_err("one triangle is no ball").to_string();
        assert!(error.contains("max_triangles is 1") && error.contains("more"), "{error}");
    }

    #[test]
    fn pieces_too_small_for_the_budget_go_and_the_rest_keeps_its_shape() {
        let mut mesh = ball(Vec3::ZERO, 1.0, 5);
        for i in 0..100 {
            mesh.append(ball(Vec3::X * (3.0 + i as f32), 0.01, 2)).unwrap();
        }
        let simple = simplified(&mesh, 200).unwrap();
        assert!((100..=200).contains(&simple.face_count()));
        assert!(simple.positions.iter().all(|p| (0.95..1.05).contains(&p.length())), "the large one is left");
    }
}
