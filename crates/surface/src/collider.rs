//! The collider of a mesh whose triangles share edges: the mesh itself, of fewer triangles. Colours
//! and seams do not matter to it.

use crate::collapse::vertex_data;
use crate::connected::{connected_faces, first_with_key};
use crate::fill::drop_small;
use crate::options::SurfaceDetails;
use crate::simplify::{TooFewTriangles, drop_unused, simplify};
use meshopt::SimplifyOptions;
use trisplat_scene::math::geometry::place_bits;
use trisplat_scene::mesh::{Colors, Mesh};

/// Triangles of the mesh per triangle of its collider.
const MESH_FACES_PER_FACE: usize = 8;
/// Maximum move of the surface without a limit of triangles, as a share of its size: boxes stay
/// boxes.
const MAX_ERROR: f32 = 0.01;

/// The collider of `mesh`, of at most `most` triangles; without that of an eighth of its triangles,
/// or more where its shape needs them. Closed where the mesh is. `None` if fewer than half of the
/// triangles share edges.
///
/// # Errors
///
/// A limit so low that nothing is left.
pub(super) fn collider(
    mesh: &Mesh,
    most: Option<usize>,
    details: &mut SurfaceDetails,
) -> Result<Option<Mesh>, TooFewTriangles> {
    let connected = connected_faces(mesh).into_iter().filter(|is_connected| *is_connected).count();
    if connected == 0 || 2 * connected < mesh.face_count() {
        return Ok(None);
    }
    let mut collider = welded(mesh);
    details.extracted = collider.face_count() as u64;
    match most {
        Some(most) => {
            if let Some(simplified) = simplify(&mut collider, most)? {
                details.simplification_error = Some(simplified.error);
            }
        }
        None => {
            let most = collider.face_count() / MESH_FACES_PER_FACE;
            details.simplification_error = Some(collapse_within(&mut collider, most, MAX_ERROR));
        }
    }
    details.components = drop_small(&mut collider, 0).remaining;
    Ok(Some(collider))
}

/// The faces of a mesh without its shell, sharing a vertex wherever they touch, in one colour.
fn welded(mesh: &Mesh) -> Mesh {
    let first = first_with_key(mesh.vertex_count(), |vertex| place_bits(mesh.positions[vertex]));
    let is_whole = |[a, b, c]: &[u32; 3]| a != b && b != c && c != a;
    let is_finite = |face: &usize| mesh.corners(*face).iter().all(|corner| corner.is_finite());
    let faces = (0..mesh.face_count()).filter(|face| !mesh.is_shell(*face)).filter(is_finite);
    let indices = faces.map(|face| mesh.face(face).map(|vertex| first[vertex as usize]));
    let mut welded = Mesh {
        positions: mesh.positions.clone(),
        colors: Colors::Vertex(vec![[0.5; 3]; mesh.vertex_count()]),
        indices: indices.filter(is_whole).flatten().collect(),
        ..Mesh::default()
    };
    drop_unused(&mut welded);
    welded
}

/// Collapses edges down to `most` faces, while the surface moves at most by a share of its size.
/// Returns how far it moved.
fn collapse_within(mesh: &mut Mesh, most: usize, max_error: f32) -> f64 {
    let Some((vertices, scale)) = vertex_data(&mesh.positions) else { return 0.0 };
    let mut error = 0.0;
    let options = SimplifyOptions::None;
    mesh.indices =
        meshopt::simplify(&mesh.indices, &vertices, 3 * most, max_error, options, Some(&mut error));
    drop_unused(mesh);
    f64::from(error * scale)
}
