//! Connected pieces of a mesh.

use trisplat_scene::math::sets::Sets;
use trisplat_scene::mesh::Mesh;

/// What [`drop_small`] did.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Components {
    /// Pieces that are left.
    pub(super) kept: u64,
    /// Faces of the others.
    pub(super) dropped_faces: u64,
}

/// Drops pieces of fewer than `least` faces, and vertices that no face uses. Faces are connected that share a vertex.
pub(super) fn drop_small(mesh: &mut Mesh, least: u32) -> Components {
    let pieces = pieces(mesh);
    let mut faces = vec![0u32; mesh.vertex_count()];
    pieces.iter().for_each(|piece| faces[*piece as usize] += 1);
    keep_pieces(mesh, &pieces, |piece| faces[piece] > 0 && faces[piece] >= least)
}

/// Drops pieces with less than `share` of the area of all; the largest stays.
pub(super) fn drop_small_areas(mesh: &mut Mesh, share: f64) -> Components {
    let pieces = pieces(mesh);
    let mut areas = vec![0.0; mesh.vertex_count()];
    pieces.iter().enumerate().for_each(|(face, piece)| areas[*piece as usize] += mesh.area(face));
    let (all, largest) = (areas.iter().sum::<f64>(), areas.iter().copied().fold(0.0, f64::max));
    let least = f64::min(share * all, largest);
    keep_pieces(mesh, &pieces, |piece| areas[piece] > 0.0 && areas[piece] >= least)
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
    let kept = (0..mesh.vertex_count()).filter(|piece| stays(*piece)).count() as u64;
    mesh.retain(|face| stays(pieces[face] as usize));
    Components { kept, dropped_faces: (before - mesh.face_count()) as u64 }
}

#[cfg(test)]
mod tests {
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
        let wants = Components { kept: 1, dropped_faces: 1 };
        assert_eq!(drop_small(&mut mesh, 2), wants);
        assert_eq!((mesh.face_count(), mesh.vertex_count()), (4, 6));
        assert_eq!(drop_small(&mut mesh, 5), Components { kept: 0, dropped_faces: 4 });
        assert_eq!((mesh.face_count(), mesh.vertex_count()), (0, 0));
    }

    #[test]
    fn pieces_of_little_area_go_and_the_largest_stays() {
        // Right triangles at distance, with legs 1, 2 and 3: areas 0.5, 2 and 4.5.
        let triangle = |side: f32| [Vec3::ZERO, Vec3::X * side, Vec3::Y * side].map(|p| p + Vec3::Z * side);
        let mut mesh = Mesh {
            positions: [1.0, 2.0, 3.0].into_iter().flat_map(triangle).collect(),
            colors: Colors::Vertex(vec![[0.5; 3]; 9]),
            indices: (0..9).collect(),
            ..Mesh::default()
        };
        assert_eq!(drop_small_areas(&mut mesh, 0.1), Components { kept: 2, dropped_faces: 1 });
        assert_eq!(drop_small_areas(&mut mesh, 0.99), Components { kept: 1, dropped_faces: 1 });
        assert_eq!(mesh.area(0), 4.5);
    }
}
