//! Where a subject stands: the origin is under it, and it faces the viewer.

use super::ground;
use super::samples::Foreground;
use super::up::Evidence;
use super::{PlaceDetails, PlaceOptions, placement};
use glam::{DVec3, Vec3};
use trisplat_raster::framing::{Scenery, viewpoint};
use trisplat_scene::{Placement, Provenance, camera::Camera, mesh::Mesh, placed};

/// The placement by `options`. The origin of a `subject` is under the middle of its bounds, at the height that it stands on. Unless
/// `options` turn it, the side of the first viewpoint faces +Z, the front of glTF. `known` is in the frame of `mesh`.
pub(crate) fn placement_of(
    subject: bool,
    mesh: &Mesh,
    provenance: &Provenance,
    known: Evidence,
    options: &PlaceOptions,
    details: &mut PlaceDetails,
) -> Placement {
    if !subject {
        return placement(mesh, provenance, known, options, details);
    }
    let grounded = PlaceOptions { ground: true, ..options.clone() };
    let how = placement(mesh, provenance, known, &grounded, details);
    let scene = Foreground::new(mesh, provenance.backdrop);
    details.ground = ground::under(scene, details.ground, how.up.vector());
    let Some(floor) = details.ground else { return how };
    let how = standing(scene, how, floor);
    // Whoever turns it chooses where it faces.
    let turn = if options.rotate == 0.0 { front(mesh, &how, known.cameras) } else { None };
    turn.map_or(how, |rotate| standing(scene, Placement { rotate, ..how }, floor))
}

/// The same placement with the origin under the middle of the bounds, at the height `floor`.
fn standing(scene: Foreground, how: Placement, floor: f64) -> Placement {
    let turned = Placement { center: [0.0; 3], scale: 1.0, ..how };
    let turn = turned.transform();
    let places = scene.vertices().iter().map(|place| turn(*place));
    let (low, high) =
        places.fold((Vec3::MAX, Vec3::MIN), |(low, high), place| (low.min(place), high.max(place)));
    let middle = (low + high) / 2.0;
    let under = turned.to_world_f64(Vec3::new(middle.x, floor as f32, middle.z));
    Placement { center: under.to_array(), ..how }
}

/// The turn about the up axis, degrees, after which the first viewpoint of a subject placed by `how` is towards +Z. `None` without
/// cameras, which alone know its front.
fn front(mesh: &Mesh, how: &Placement, cameras: &[Camera]) -> Option<f64> {
    if cameras.is_empty() {
        return None;
    }
    let cameras: Vec<Camera> = cameras.iter().map(|c| placed::to_file(c, how, DVec3::ZERO)).collect();
    let transform = how.transform();
    let corners = |face: usize| mesh.corners(face).map(&transform);
    let (count, up) = (mesh.face_count(), Vec3::Y);
    let scenery = Scenery { corners: &corners, count, cameras: &cameras, up, room: &|_| f32::INFINITY };
    let first = viewpoint(&scenery)?.viewpoint;
    let away = DVec3::from(first.eye) - DVec3::from(first.target);
    let turn = -libm::atan2(away.x, away.z).to_degrees();
    turn.is_finite().then_some(turn)
}

#[cfg(test)]
mod tests {
    use super::super::place;
    use super::super::words::UpChoice;
    use super::*;
    use glam::UVec2;
    use trisplat_scene::UpAxis;
    use trisplat_scene::camera::Viewpoint;
    use trisplat_scene::mesh::Colors;

    /// A box of small triangles without a bottom, denser on one side: its largest layer is the top.
    fn crate_without_bottom() -> Mesh {
        let mut mesh = Mesh::default();
        let mut wall = |from: Vec3, u: Vec3, v: Vec3, cells: usize| {
            for (i, k) in (0..cells).flat_map(|i| (0..cells).map(move |k| (i, k))) {
                let at = |i: usize, k: usize| from + (u * i as f32 + v * k as f32) / cells as f32;
                mesh.positions.extend([at(i, k), at(i + 1, k), at(i, k + 1)]);
                mesh.positions.extend([at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)]);
            }
        };
        let corner = Vec3::new(5.0, 2.0, -1.0);
        wall(corner, Vec3::X, Vec3::Y, 10);
        wall(corner, Vec3::Z, Vec3::Y, 40);
        wall(corner + Vec3::X, Vec3::Z, Vec3::Y, 10);
        wall(corner + Vec3::Z, Vec3::X, Vec3::Y, 10);
        wall(corner + Vec3::Y, Vec3::X, Vec3::Z, 10);
        mesh.colors = Colors::Face(vec![[0.5; 3]; mesh.face_count()]);
        mesh
    }

    #[test]
    fn the_origin_is_under_a_subject_without_a_floor() {
        let (mut mesh, mut details) = (crate_without_bottom(), PlaceDetails::default());
        let options = PlaceOptions {
            up: UpChoice::Given(UpAxis::Y.into()),
            rotate: 90.0,
            scale: 2.0,
            ..PlaceOptions::DEFAULT
        };
        let mut provenance = Provenance::default();
        let how = placement_of(true, &mesh, &provenance, Evidence::default(), &options, &mut details);
        place(&mut mesh, &mut provenance, how, &mut details).unwrap();
        let bounds = mesh.positions.iter().fold((Vec3::MAX, Vec3::MIN), |(a, b), p| (a.min(*p), b.max(*p)));
        let (low, high) = bounds;
        assert!(low.y <= 0.0 && low.y > -0.15 && high.y > 1.85, "{bounds:?}");
        assert!((low.x + high.x).abs() < 1e-4 && (low.z + high.z).abs() < 1e-4, "{bounds:?}");
    }

    #[test]
    fn a_subject_faces_the_side_that_photos_show_best_unless_it_is_turned() {
        let mesh = crate_without_bottom();
        let middle = Vec3::new(5.5, 2.5, -0.5);
        let photo = Viewpoint {
            eye: [0.0; 3],
            target: [1.0; 3],
            up: [0.0, 1.0, 0.0],
            fov: 40.0,
            radius: None,
            orbit: None,
        };
        let photo =
            photo.camera(UVec2::new(120, 90)).looking(middle + Vec3::new(-3.0, 0.5, 1.0), middle, Vec3::Y);
        let faces = |rotate: f64| {
            let up = UpChoice::Given(UpAxis::Y.into());
            let options = PlaceOptions { up, rotate, ..PlaceOptions::DEFAULT };
            let known = Evidence { cameras: &[photo], points: &[] };
            let how = placement_of(
                true,
                &mesh,
                &Provenance::default(),
                known,
                &options,
                &mut PlaceDetails::default(),
            );
            (placed::to_file(&photo, &how, DVec3::ZERO).position(), how.rotate)
        };
        let (eye, turn) = faces(0.0);
        assert!(eye.z > 2.5 && eye.x.abs() < 0.2 && turn != 0.0, "{eye} after {turn}");
        let (eye, turn) = faces(30.0);
        assert!(turn == 30.0 && eye.x < -1.0, "{eye} after {turn}");
    }
}
