//! Fewer triangles for the same surface, by the quadric errors of meshoptimizer.

use crate::math::color::srgb_from_linear;
use crate::mesh::{Colors, Mesh};
use meshopt::{SimplifyOptions, VertexDataAdapter};

/// How much a change of colour counts: one from black to white as a move by this share of the mesh's size.
const COLOR_WEIGHT: f32 = 0.02;

/// Simplifies an indexed mesh with colours per vertex to at most `most` faces. Returns how far the surface moved, units of the mesh;
/// `None` when it had no more already.
pub(super) fn simplify(mesh: &mut Mesh, most: usize) -> Option<f64> {
    if mesh.face_count() <= most {
        return None;
    }
    let Colors::Vertex(colors) = &mesh.colors else { return None };
    let codes: Vec<f32> = colors.iter().flatten().map(|channel| srgb_from_linear(*channel)).collect();
    let bytes: &[u8] = bytemuck::cast_slice(&mesh.positions);
    let vertices = VertexDataAdapter::new(bytes, size_of::<glam::Vec3>(), 0).ok()?;
    let scale = meshopt::simplify_scale(&vertices);
    let mut error = 0.0;
    // No vertex is locked. An empty list would be read beyond its end.
    let mut indices = meshopt::simplify_with_attributes_and_locks(
        &mesh.indices,
        &vertices,
        &codes,
        &[COLOR_WEIGHT; 3],
        3 * size_of::<f32>(),
        &vec![false; mesh.vertex_count()],
        3 * most,
        f32::MAX,
        SimplifyOptions::Prune,
        Some(&mut error),
    );
    // It keeps the topology, which may need more triangles than there may be; this one does not.
    if indices.len() > 3 * most {
        indices = meshopt::simplify_sloppy(&indices, &vertices, 3 * most, f32::MAX, Some(&mut error));
    }
    mesh.indices = indices;
    let faces: Vec<u32> = (0..mesh.face_count() as u32).collect();
    mesh.keep(&faces);
    Some(f64::from(error * scale))
}
