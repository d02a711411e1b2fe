//! Counts of a scene for reports.

use trisplat_scene::{Asset, Scene, mesh::Mesh, report::Counts};

/// Of a soup or a mesh.
pub fn count(scene: &Scene) -> Counts {
    match scene {
        Scene::Soup(soup) => Counts { triangles: soup.len() as u64, vertices: 3 * soup.len() as u64 },
        Scene::Mesh(mesh) => count_mesh(mesh),
    }
}

/// Of a mesh.
pub(super) fn count_mesh(mesh: &Mesh) -> Counts {
    Counts { triangles: mesh.face_count() as u64, vertices: mesh.vertex_count() as u64 }
}

/// The counts of all levels of detail together.
#[expect(clippy::ptr_arg, reason = "the signature that a report measures a list of levels by")]
pub(super) fn count_levels(levels: &Vec<Asset>) -> Counts {
    let counts = levels.iter().map(Asset::counts);
    counts.fold(Counts::default(), |a, b| Counts {
        triangles: a.triangles + b.triangles,
        vertices: a.vertices + b.vertices,
    })
}
