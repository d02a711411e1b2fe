//! Connected parts of a mesh: triangles that share edges, which levels of detail simplify as a
//! surface. All others are a soup of triangles.
//!
//! In: any mesh. Out: a flag for each face. Corners are shared where their positions agree bit for
//! bit, because files repeat the vertices at seams of a texture, or all of them.

use rayon::prelude::*;
use trisplat_scene::math::geometry::place_bits;
use trisplat_scene::math::lists::Sets;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};

/// Minimum number of triangles of a connected part: edges of a leaf of two triangles or of a
/// pyramid cannot collapse without loss.
const MIN_FACES: u32 = 8;
/// Maximum number of faces at an edge of a surface, as where two walls cross. More are a stack of
/// triangles.
const MAX_FACES_AT_EDGE: usize = 4;

/// True for faces of a part whose triangles share edges. Faces of a shell and with harmonics of
/// their own never are. `[F]`
pub fn connected_faces(mesh: &Mesh) -> Vec<bool> {
    connected_parts(mesh).iter().map(Option::is_some).collect()
}

/// The first face of each face's part, whose triangles share edges; `None` for triangles that are
/// not [connected](connected_faces). `[F]`
pub fn connected_parts(mesh: &Mesh) -> Vec<Option<u32>> {
    let faces = mesh.face_count();
    if mesh.sh.is_some() {
        return vec![None; faces];
    }
    let Places { of_vertices, is_shared } = Places::of(mesh);
    let sides = |face: usize| {
        let [a, b, c] = mesh.face(face).map(|vertex| of_vertices[vertex as usize]);
        let side = |p: u32, q: u32| (p.min(q), p.max(q), face as u32);
        [side(a, b), side(b, c), side(c, a)]
    };
    let is_between_faces =
        |(p, q, _): &(u32, u32, u32)| p != q && is_shared[*p as usize] && is_shared[*q as usize];
    let scene_faces = (0..faces).into_par_iter().filter(|face| !mesh.is_shell(*face));
    let mut sides: Vec<(u32, u32, u32)> =
        scene_faces.flat_map_iter(sides).filter(is_between_faces).collect();
    sides.par_sort_unstable();
    let mut parts = Sets::new(faces);
    let edges = sides.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1));
    for edge in edges.filter(|edge| edge.len() <= MAX_FACES_AT_EDGE) {
        for side in edge {
            parts.join(edge[0].2, side.2);
        }
    }
    let part_of: Vec<u32> = (0..faces as u32).map(|face| parts.first(face)).collect();
    let mut sizes = vec![0; faces];
    for part in &part_of {
        sizes[*part as usize] += 1;
    }
    part_of.into_iter().map(|part| (sizes[part as usize] >= MIN_FACES).then_some(part)).collect()
}

/// Places of the vertices of a mesh.
struct Places {
    /// The first vertex at the place of each vertex. `[V]`
    of_vertices: Vec<u32>,
    /// True for places that several corners of faces have. `[V]`
    is_shared: Vec<bool>,
}

impl Places {
    fn of(mesh: &Mesh) -> Self {
        let of_vertices =
            first_with_key(mesh.vertex_count(), |vertex| place_bits(mesh.positions[vertex]));
        let mut corners = vec![0u8; of_vertices.len()];
        for vertex in (0..mesh.face_count()).flat_map(|face| mesh.face(face)) {
            let count = &mut corners[of_vertices[vertex as usize] as usize];
            *count = count.saturating_add(1);
        }
        Self { of_vertices, is_shared: corners.iter().map(|count| *count > 1).collect() }
    }
}

/// The first index with the key of each index.
pub(super) fn first_with_key<K: Ord + Copy + Send + Sync>(
    count: usize,
    key: impl Fn(usize) -> K + Sync,
) -> Vec<u32> {
    let mut order: Vec<(K, u32)> = parallel::collect(count, GRAIN, |i| (key(i), i as u32));
    order.par_sort_unstable();
    let mut first = vec![0; count];
    for run in order.chunk_by(|a, b| a.0 == b.0) {
        for (_, index) in run {
            first[*index as usize] = run[0].1;
        }
    }
    first
}
