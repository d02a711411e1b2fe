//! Places to look at a subject from: those of its photos, and rings around it.

use super::subject::Subject;
use glam::{UVec2, Vec2, Vec3};
use trisplat_scene::UpDirection;
use trisplat_scene::camera::Camera;

/// Maximum number of photos among the candidates.
const MAX_PHOTOS: usize = 64;
/// Tangent of half the field of view of places around the subject.
const HALF_FOV_TAN: f32 = 0.414_213_57; // 45 degrees
/// Number of directions around the subject.
const AROUND: usize = 12;
/// Size of a picture from around, in sizes of the subject.
const MARGIN: f32 = 1.1;
/// Sine of half the angle of the widest lens from around.
const MAX_SINE_AROUND: f32 = 0.8;
/// Width and height of the pictures from around, px.
const SIZE: UVec2 = UVec2::new(960, 720);

/// A place to look from.
#[derive(Debug, Clone, Copy)]
pub(super) struct ViewpointCandidate {
    pub(super) camera: Camera,
    /// Number of its photo, if any.
    pub(super) photo: Option<usize>,
}

/// The cameras of photos, made level, and turned to the subject if they show its middle.
pub(super) fn photo_candidates(
    cameras: &[Camera],
    subject: Subject,
    up: Vec3,
) -> Vec<ViewpointCandidate> {
    let step = cameras.len().div_ceil(MAX_PHOTOS).max(1);
    let level = |photo: usize| {
        let camera = &cameras[photo];
        let eye = camera.position();
        let target = if camera.is_in_frustum(subject.center) {
            subject.center
        } else {
            eye + camera.rotation.row(2)
        };
        let camera = Camera { center: camera.size.as_vec2() / 2.0, ..*camera };
        ViewpointCandidate { camera: camera.with_look_at(eye, target, up), photo: Some(photo) }
    };
    (0..cameras.len()).step_by(step).map(level).collect()
}

/// Tangent of half the visual angle of a ball at a distance, at most that of an angle with this
/// sine.
pub(super) fn half_tangent(radius: f32, distance: f32, max_sine: f32) -> f32 {
    let sine = (radius / distance).min(max_sine);
    sine / (1.0 - sine * sine).sqrt()
}

/// A ring of cameras around the subject at an elevation of this sine. Their distance shows the
/// whole subject, times `nearer`, and is at most `max_distance`, with a wider lens, inside a far
/// shell.
pub(super) fn ring(
    subject: Subject,
    up: Vec3,
    sine: f32,
    nearer: f32,
    max_distance: f32,
) -> Vec<ViewpointCandidate> {
    let sin_half = HALF_FOV_TAN / (1.0 + HALF_FOV_TAN * HALF_FOV_TAN).sqrt();
    let whole = MARGIN * subject.radius / sin_half;
    let distance = (nearer * whole).min(max_distance);
    // The lens that shows the whole subject from there, if it must be wider.
    let tangent = half_tangent(MARGIN * subject.radius, distance, MAX_SINE_AROUND);
    let focal = Vec2::splat(SIZE.y as f32 / (2.0 * tangent.max(HALF_FOV_TAN)));
    // Of the Y-up frame that a bake turns the scene to, so that a scene and its file begin alike.
    let to_file = UpDirection::near(up.as_dvec3()).to_y_up().as_mat3();
    let x = to_file.transpose() * Vec3::Y.any_orthonormal_vector();
    let y = up.cross(x);
    let cosine = (1.0 - sine * sine).sqrt();
    directions()
        .map(|[cos, sin]| {
            let eye = subject.center + distance * (up * sine + (x * cos + y * sin) * cosine);
            let lens = Camera::look_at(eye, subject.center, up, 1.0, SIZE);
            ViewpointCandidate { camera: Camera { focal, ..lens }, photo: None }
        })
        .collect()
}

/// Cosines and sines of twelve directions around a circle, as constants: the same on every system.
fn directions() -> impl Iterator<Item = [f32; 2]> {
    const HALF_ROOT_3: f32 = 0.866_025_4;
    let quarter = [[1.0, 0.0], [HALF_ROOT_3, 0.5], [0.5, HALF_ROOT_3]];
    (0..AROUND).map(move |i| {
        let [c, s] = quarter[i % 3];
        match i / 3 {
            0 => [c, s],
            1 => [-s, c],
            2 => [-c, -s],
            _ => [s, -c],
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Mat3;

    #[test]
    fn photos_are_level_and_look_at_the_subject() {
        let subject = Subject { center: Vec3::Z * 5.0, radius: 1.0, is_alone: false };
        let tilted = Camera {
            rotation: Mat3::from_rotation_z(0.7) * Mat3::from_rotation_x(0.1),
            translation: Vec3::ZERO,
            focal: Vec2::splat(100.0),
            center: Vec2::new(40.0, 60.0),
            size: UVec2::splat(100),
        };
        let away = Camera { rotation: Mat3::from_rotation_y(3.0), ..tilted };
        let [facing, turned_away] = photo_candidates(&[tilted, away], subject, Vec3::Y)[..] else {
            panic!("two photos")
        };
        let at = facing.camera.rotation * subject.center + facing.camera.translation;
        assert!(at.truncate().length() < 1e-4 && at.z > 0.0);
        for candidate in [facing, turned_away] {
            assert!((candidate.camera.rotation * Vec3::Y).x.abs() < 1e-5, "level");
        }
        assert!(turned_away.camera.rotation.row(2).z < 0.0, "looks where it looked");
    }

    #[test]
    fn a_ring_shows_the_subject_and_stays_inside_the_shell() {
        let subject = Subject { center: Vec3::new(1.0, 2.0, 3.0), radius: 2.0, is_alone: false };
        for (nearer, room) in [(1.0, f32::INFINITY), (1.0, 3.0), (0.6, f32::INFINITY)] {
            let ring = ring(subject, Vec3::Y, 0.4, nearer, room);
            assert_eq!(ring.len(), AROUND);
            for ViewpointCandidate { camera, .. } in &ring {
                let away = camera.position().distance(subject.center);
                assert!(away <= room * 1.001 && away > subject.radius, "{away}");
                assert!(
                    (camera.rotation * Vec3::Y).y < 0.0
                        && (camera.rotation * Vec3::Y).x.abs() < 1e-5
                );
                assert!(camera.is_in_frustum(subject.center + Vec3::Y * 1.5));
            }
            let [a, b] = [0, AROUND / 2].map(|i| ring[i].camera.position());
            assert!(a.distance(b) > 2.0, "all around");
        }
    }

    #[test]
    fn ring_turns_with_the_scene_as_the_bake_turns_it() {
        let subject = |center: Vec3| Subject { center, radius: 1.0, is_alone: true };
        let center = Vec3::new(1.0, 2.0, 3.0);
        for up in [Vec3::NEG_Y, Vec3::Z, Vec3::X, Vec3::new(0.2, -0.9, 0.3).normalize()] {
            let to_file = UpDirection::near(up.as_dvec3()).to_y_up().as_mat3();
            let scene = ring(subject(center), up, 0.3, 1.0, 9.0);
            let file = ring(subject(to_file * center), Vec3::Y, 0.3, 1.0, 9.0);
            for (scene, file) in scene.iter().zip(&file) {
                let turned = to_file * scene.camera.position();
                assert!(turned.distance(file.camera.position()) < 1e-4, "{up}");
            }
        }
    }
}
