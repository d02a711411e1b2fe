//! What reports count of a scene.

use crate::mesh::Mesh;
use crate::report::Counts;
use crate::scene::Scene;

/// Of a soup or a mesh.
pub(super) fn count(scene: &Scene) -> Counts {
    match scene {
        Scene::Soup(soup) => Counts { triangles: soup.len() as u64, vertices: 3 * soup.len() as u64 },
        Scene::Mesh(mesh) => count_mesh(mesh),
    }
}

/// Of a mesh.
pub(super) fn count_mesh(mesh: &Mesh) -> Counts {
    Counts { triangles: mesh.face_count() as u64, vertices: mesh.vertex_count() as u64 }
}
