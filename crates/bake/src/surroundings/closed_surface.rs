//! The closed surface behind a scene, as seen from a middle, and its places on an equirectangular
//! picture.
//!
//! The surface lies at the shell of a training, which stands where walls are; without one, behind
//! everything.

use glam::{Vec2, Vec3};
use std::f64::consts::{PI, TAU};
use trisplat_raster::framing::ray_triangle_distance;
use trisplat_scene::math::geometry::octasphere;
use trisplat_scene::math::lists::median;
use trisplat_scene::mesh::{Colors, Mesh};

/// Rounds in which each distance is drawn towards its neighbours'.
const ROUNDS: usize = 200;
/// Weight of the shell's distance in a direction, against that of one neighbour's.
const SHELL_WEIGHT: f32 = 6.0;

/// The direction of a place of the picture: (0, 0) is its upper left corner, (1, 1) its lower right
/// one. The first column is -X, a quarter of the way is -Z, the middle is +X, as three.js has it.
pub(super) fn direction(place: Vec2) -> Vec3 {
    let (sine, cosine) = libm::sincos((f64::from(place.x) - 0.5) * TAU);
    let (across, up) = libm::sincos(f64::from(place.y) * PI);
    Vec3::new((across * cosine) as f32, up as f32, (across * sine) as f32)
}

/// The place of a direction.
pub(super) fn place(direction: Vec3) -> Vec2 {
    let [x, y, z] = direction.normalize_or(Vec3::Y).to_array().map(f64::from);
    let turn = libm::atan2(z, x) / TAU + 0.5;
    Vec2::new(turn as f32, (libm::acos(y.clamp(-1.0, 1.0)) / PI) as f32)
}

/// The surface around `center` where `shell` is, but at least `min_radius` away, and the places of
/// its corners on the picture; fronts are inside. `[F]`
pub(super) fn closed_surface(
    center: Vec3,
    subdivisions: u32,
    shell: Option<&Mesh>,
    min_radius: f32,
) -> (Mesh, Vec<[Vec2; 3]>) {
    let (corners, faces) = octasphere(subdivisions);
    let distances = match shell {
        Some(shell) => distances(&corners, &faces, &|ray| shell_distance(shell, center, ray)),
        None => vec![min_radius; corners.len()],
    };
    let faces: Vec<[usize; 3]> =
        faces.into_iter().map(|[a, b, c]| [a, c, b].map(|i| i as usize)).collect();
    let at = |i: usize| center + corners[i] * distances[i].max(min_radius);
    let uvs = faces.iter().map(|face| face_places(face.map(|i| corners[i]))).collect();
    let positions: Vec<Vec3> = faces.into_iter().flatten().map(at).collect();
    let colors = Colors::Face(vec![[0.0; 3]; positions.len() / 3]);
    (Mesh { positions, colors, ..Mesh::default() }, uvs)
}

/// Places of a face's corners, moved across the edges of the picture so that the face is in one
/// piece.
fn face_places(corners: [Vec3; 3]) -> [Vec2; 3] {
    let middle = place(corners.into_iter().sum());
    // The first and the last column are one direction, and all columns meet in a pole.
    let nearest_place =
        |corner: Vec3| place(corner) - Vec2::X * (place(corner).x - middle.x).round();
    let is_pole = |corner: Vec3| corner.x == 0.0 && corner.z == 0.0;
    let others = corners
        .into_iter()
        .filter(|corner| !is_pole(*corner))
        .map(|corner| nearest_place(corner).x);
    let mean = others.sum::<f32>() / 2.0;
    corners.map(|corner| {
        if is_pole(corner) { Vec2::new(mean, place(corner).y) } else { nearest_place(corner) }
    })
}

/// Distance of the farthest face of the shell in a direction.
fn shell_distance(shell: &Mesh, center: Vec3, ray: Vec3) -> Option<f32> {
    let hits = (0..shell.face_count())
        .filter_map(|face| ray_triangle_distance(shell.corners(face), center, ray));
    hits.reduce(f32::max)
}

/// The distance of each corner of a sphere: about `shell_distance` where that is known, else
/// between its neighbours'. `[V]`
fn distances(
    corners: &[Vec3],
    faces: &[[u32; 3]],
    shell_distance: &dyn Fn(Vec3) -> Option<f32>,
) -> Vec<f32> {
    // In logarithms, so that twice and half the distance count equally.
    let shell_logs: Vec<Option<f32>> =
        corners.iter().map(|corner| shell_distance(*corner).map(f32::ln)).collect();
    let typical =
        median(shell_logs.iter().flatten().copied().collect(), f32::total_cmp).unwrap_or(0.0);
    let mut logs: Vec<f32> =
        shell_logs.iter().map(|shell_log| shell_log.unwrap_or(typical)).collect();
    for _ in 0..ROUNDS {
        let mut sums: Vec<[f32; 2]> = shell_logs
            .iter()
            .map(|shell_log| shell_log.map_or([0.0; 2], |log| [SHELL_WEIGHT * log, SHELL_WEIGHT]))
            .collect();
        for face in faces {
            for k in 0..3 {
                let [to, from] = [face[k], face[(k + 1) % 3]].map(|i| i as usize);
                sums[to][0] += logs[from];
                sums[to][1] += 1.0;
            }
        }
        for (log, [sum, count]) in logs.iter_mut().zip(sums) {
            *log = sum / count;
        }
    }
    logs.into_iter().map(f32::exp).collect()
}

// ---- Shared by backdrops and skies ---------------------------------------------------

/// Minimum share of the drawn pictures that show the scene, and of the photos' pixels outside
/// masks, below which the scene is an object without background.
pub(super) const MIN_COVERED: f64 = 0.8;
/// Radius of the sphere as a multiple of the distance of the farthest vertex or camera.
pub(super) const RADIUS_FACTOR: f32 = 1.2;
/// Maximum number of subdivisions of the octahedron: 8 · 4⁴ triangles.
pub(super) const MAX_SUBDIVISIONS: u32 = 4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_closed_where_the_shell_is_and_has_no_spike() {
        let center = Vec3::new(1.0, -2.0, 0.5);
        let (mut shell, _) = closed_surface(center, 4, None, 3.0);
        // A spike, and an opening.
        for vertex in shell.positions.iter_mut().filter(|vertex| vertex.y > 0.99) {
            vertex.y = 60.0;
        }
        let closed = shell.clone();
        shell.retain(|face| closed.centroid(face).x < 3.5);
        let (mesh, uvs) = closed_surface(center, 3, Some(&shell), 1.0);
        assert_eq!((mesh.face_count(), uvs.len()), (512, 512));
        let mut edges = std::collections::BTreeMap::new();
        for face in 0..512 {
            let [a, b, c] = mesh.corners(face).map(|v| v.to_array().map(f32::to_bits));
            for edge in [(a, b), (b, c), (c, a)] {
                *edges.entry(edge).or_insert(0) += 1;
            }
            assert!(mesh.flat_normal(face).dot(center - mesh.centroid(face)) > 0.0, "inside");
        }
        assert!(edges.iter().all(|((a, b), n)| *n == 1 && edges.contains_key(&(*b, *a))));
        let away = |v: Vec3| v.distance(center);
        let most = mesh.positions.iter().map(|v| away(*v)).fold(0.0, f32::max);
        assert!(most < 40.0 && mesh.positions.iter().all(|v| away(*v) > 2.8), "{most}");
        let level = mesh.positions.iter().filter(|v| v.y < center.y);
        assert!(
            level.clone().all(|v| (2.8..3.6).contains(&away(*v))),
            "{:?}",
            level.collect::<Vec<_>>()
        );
        let (around_cameras, _) = closed_surface(center, 3, Some(&shell), 5.0);
        assert!(around_cameras.positions.iter().all(|v| away(*v) > 4.99));
    }

    #[test]
    fn places_are_directions_and_faces_cover_the_picture_once() {
        for i in 0..200u16 {
            let at = Vec2::new(f32::from(i % 20) / 20.0, (f32::from(i / 20) + 0.5) / 10.0);
            assert!((place(direction(at)) - at).length() < 1e-4, "{at}");
        }
        let (_, uvs) = closed_surface(Vec3::ZERO, 4, None, 1.0);
        assert!(
            uvs.as_flattened()
                .iter()
                .all(|uv| uv.cmpge(Vec2::ZERO).all() && uv.cmple(Vec2::ONE).all())
        );
        let area: f32 = uvs.iter().map(|[a, b, c]| (b - a).perp_dot(c - a).abs() / 2.0).sum();
        // All but half of the faces at the poles.
        assert!((0.96..=1.0).contains(&area), "{area}");
    }
}
