//! Candidates for the first viewpoint: the places of photos, or places around the subject.

use super::Subject;
use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_scene::camera::Camera;

/// Most photos that are tried.
const MOST_PHOTOS: usize = 64;
/// Field of view of places around the subject, degrees; the tangents of its half.
const HALF_FOV_TAN: f32 = 0.414_213_57; // 45 degrees
/// Directions around the subject.
const AROUND: usize = 12;
/// Size of a picture from around, in sizes of the subject.
const MARGIN: f32 = 1.1;
/// Sine of half the angle of the widest lens from around.
const MOST_SINE_AROUND: f32 = 0.8;
/// Width and height of the pictures from around, px.
const SIZE: UVec2 = UVec2::new(960, 720);

/// A place to look from.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) camera: Camera,
    /// The number of its photo, if any.
    pub(super) photo: Option<usize>,
}

/// The cameras of photos, made level, and turned to the subject if they show its middle.
pub(super) fn of_photos(cameras: &[Camera], subject: Subject, up: Vec3) -> Vec<Candidate> {
    let step = cameras.len().div_ceil(MOST_PHOTOS).max(1);
    let level = |photo: usize| {
        let camera = &cameras[photo];
        let eye = camera.position();
        let target = match camera.frames(subject.center) {
            true => subject.center,
            false => eye + camera.rotation.row(2),
        };
        let camera = Camera { center: camera.size.as_vec2() / 2.0, ..*camera };
        Candidate { camera: camera.looking(eye, target, up), photo: Some(photo) }
    };
    (0..cameras.len()).step_by(step).map(level).collect()
}

/// Tangent of half the visual angle of a ball at a distance, at most that of an angle with this sine.
pub(super) fn half_tangent(radius: f32, distance: f32, most_sine: f32) -> f32 {
    let sine = (radius / distance).min(most_sine);
    sine / (1.0 - sine * sine).sqrt()
}

/// A ring of cameras around the subject at an elevation of this sine. Their distance shows the whole subject,
/// times `nearer`. In a scene that is closed at the distance `room`, they stay inside and have a wider lens.
pub(super) fn ring(subject: Subject, up: Vec3, sine: f32, nearer: f32, room: f32) -> Vec<Candidate> {
    let sin_half = HALF_FOV_TAN / (1.0 + HALF_FOV_TAN * HALF_FOV_TAN).sqrt();
    let whole = MARGIN * subject.radius / sin_half;
    let distance = (nearer * whole).min(room);
    // The lens that shows the whole subject from there, if it must be wider.
    let tangent = half_tangent(MARGIN * subject.radius, distance, MOST_SINE_AROUND);
    let focal = Vec2::splat(SIZE.y as f32 / (2.0 * tangent.max(HALF_FOV_TAN)));
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal,
        center: SIZE.as_vec2() / 2.0,
        size: SIZE,
    };
    let x = up.any_orthonormal_vector();
    let (y, cosine) = (up.cross(x), (1.0 - sine * sine).sqrt());
    directions()
        .map(|[cos, sin]| {
            let eye = subject.center + distance * (up * sine + (x * cos + y * sin) * cosine);
            Candidate { camera: lens.looking(eye, subject.center, up), photo: None }
        })
        .collect()
}

/// Cosines and sines of twelve directions around a circle, as constants, so that they are the same on every
/// system.
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

    #[test]
    fn a_ring_holds_the_subject_and_stays_in_its_room() {
        let subject = Subject { center: Vec3::new(1.0, 2.0, 3.0), radius: 2.0, is_alone: false };
        for (nearer, room) in [(1.0, f32::INFINITY), (1.0, 3.0), (0.6, f32::INFINITY)] {
            let ring = ring(subject, Vec3::Y, 0.4, nearer, room);
            assert_eq!(ring.len(), AROUND);
            for Candidate { camera, .. } in &ring {
                let away = camera.position().distance(subject.center);
                assert!(away <= room * 1.001 && away > subject.radius, "{away}");
                assert!((camera.rotation * Vec3::Y).y < 0.0 && (camera.rotation * Vec3::Y).x.abs() < 1e-5);
                assert!(camera.frames(subject.center + Vec3::Y * 1.5));
            }
            let [a, b] = [0, AROUND / 2].map(|i| ring[i].camera.position());
            assert!(a.distance(b) > 2.0, "all around");
        }
    }

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
        let [seen, unseen] = of_photos(&[tilted, away], subject, Vec3::Y)[..] else { panic!("two photos") };
        let at = seen.camera.rotation * subject.center + seen.camera.translation;
        assert!(at.truncate().length() < 1e-4 && at.z > 0.0);
        for candidate in [seen, unseen] {
            assert!((candidate.camera.rotation * Vec3::Y).x.abs() < 1e-5, "level");
        }
        assert!(unseen.camera.rotation.row(2).z < 0.0, "looks where it looked");
    }
}
