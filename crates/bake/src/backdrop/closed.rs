//! One closed surface in place of a shell whose triangles hardly touch: opaque, these would be shards with gaps between.

use super::limits::MOST_SUBDIVISIONS;
use super::panorama::panorama;
use super::surface::{place, surface};
use crate::weld::place_bits;
use glam::Vec3;
use std::collections::HashSet;
use trisplat_scene::{
    math::color::linear_from_srgb,
    math::octasphere::face_count,
    mesh::{Colors, Mesh},
};

/// Shells of more triangles show more detail than the surface would.
const MOST_FACES: usize = 8192;
/// Rows of the picture of the shell for each face around the surface.
const ROWS_PER_FACE: u32 = 4;

/// Whether the faces of `shell` hardly touch: a closed surface has half as many vertices as faces, separate faces have three times as many.
pub(crate) fn is_scattered(shell: &Mesh) -> bool {
    let places: HashSet<[u32; 3]> = shell.positions.iter().map(|place| place_bits(*place)).collect();
    shell.face_count() <= MOST_FACES && places.len() > shell.face_count()
}

/// A surface around `center` where `shell` is, but nowhere nearer than `least`, in the colours that the shell shows there.
pub(crate) fn closed(shell: &Mesh, center: Vec3, least: f32) -> Mesh {
    let enough = |s: &u32| face_count(*s) >= shell.face_count() as u64;
    let subdivisions = (2..MOST_SUBDIVISIONS).find(enough).unwrap_or(MOST_SUBDIVISIONS);
    let picture = panorama(shell, center, ROWS_PER_FACE << subdivisions);
    let (mut mesh, _) = surface(center, subdivisions, Some(shell), least);
    let color = |face: usize| {
        let at = place(mesh.centroid(face) - center) * picture.size.as_vec2();
        let pixel = at.as_uvec2().min(picture.size - 1);
        let codes = picture.rgb[(pixel.y * picture.size.x + pixel.x) as usize];
        codes.map(|code| linear_from_srgb(f32::from(code) / 255.0))
    };
    mesh.colors = Colors::Face((0..mesh.face_count()).map(color).collect());
    mesh
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Faces of a sphere, each turned a little about its middle and larger: they overlap and touch nowhere.
    fn scattered() -> Mesh {
        let (mut mesh, _) = surface(Vec3::ZERO, 2, None, 10.0);
        for face in 0..mesh.face_count() {
            let (middle, normal) = (mesh.centroid(face), mesh.flat_normal(face));
            for corner in &mut mesh.positions[3 * face..3 * face + 3] {
                let turned = glam::Quat::from_axis_angle(normal, 0.1 * face as f32) * (*corner - middle);
                *corner = middle + 2.0 * turned;
            }
        }
        let level = |face: usize| if mesh.centroid(face).y > 0.0 { [0.0, 0.5, 1.0] } else { [0.2; 3] };
        mesh.colors = Colors::Face((0..mesh.face_count()).map(level).collect());
        mesh
    }

    #[test]
    fn scattered_triangles_become_one_surface_in_their_colours() {
        let shell = scattered();
        assert!(is_scattered(&shell));
        let found = closed(&shell, Vec3::ZERO, 1.0);
        assert!(!is_scattered(&found) && found.face_count() == 128);
        for face in 0..found.face_count() {
            let (middle, color) = (found.centroid(face), found.corner_colors(face)[0]);
            assert!((6.0..14.0).contains(&middle.length()), "{middle}");
            let wanted = if middle.y > 0.0 { 1.0 } else { 0.2 };
            assert!(middle.y.abs() < 4.0 || (color[2] - wanted).abs() < 0.01, "{middle}: {color:?}");
        }
        assert!(closed(&shell, Vec3::ZERO, 20.0).positions.iter().all(|v| v.length() > 19.9));
    }
}
