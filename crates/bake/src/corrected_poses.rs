//! Poses that a training took from tracks: the cameras that its scene stores, for the photos of a bake.

use glam::Vec3;
use trisplat_scene::{SceneNormalization, camera::Camera};

/// Largest difference of a corrected pose, as a share of the longest side: tracks move points by a fiftieth at most, but
/// a turn and a motion of more may nearly cancel.
const MOST_SHARE: f32 = 0.05;
/// Least difference that counts; smaller ones are rounding.
const LEAST_PX: f32 = 0.01;

/// The cameras of `photos` with the poses of `stored`, those of the scene's training photos in the same frame
/// and order; drawn pictures may follow them. `None` if poses are the same, or one of them is of another photo.
pub(super) fn corrected(photos: &[Camera], stored: &[Camera], points: &[Vec3]) -> Option<Vec<Camera>> {
    let stored = stored.get(..photos.len())?;
    let unit = 1.0 / SceneNormalization::new(photos, points).scale;
    let difference = |(photo, stored): (&Camera, &Camera)| {
        let rotation = stored.rotation * photo.rotation.transpose();
        let (turn, roll) = (rotation.z_axis.truncate().length(), rotation.x_axis.y.abs());
        let motion = stored.position().distance(photo.position()) / unit;
        stored.focal.max_element() * turn.max(roll).max(motion)
    };
    let largest = photos.iter().zip(stored).map(difference).fold(0.0, f32::max);
    let pose = |(photo, stored): (&Camera, &Camera)| Camera {
        rotation: stored.rotation,
        translation: stored.translation,
        ..*photo
    };
    let side = stored.iter().map(|camera| camera.size.max_element()).max().unwrap_or(0);
    (LEAST_PX..=MOST_SHARE * side as f32)
        .contains(&largest)
        .then(|| photos.iter().zip(stored).map(pose).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2};

    #[test]
    fn poses_of_the_same_photos_are_taken_over() {
        let camera = |i: usize, size: u32, turn: f32| {
            let rotation = Mat3::from_rotation_y(0.4 * i as f32 + turn);
            let (focal, center) = (Vec2::splat(size as f32), Vec2::splat(size as f32 / 2.0));
            let translation = Vec3::new(0.0, turn, 2.0);
            Camera { rotation, translation, focal, center, size: UVec2::splat(size) }
        };
        let cameras = |turn: f32| (0..5).map(|i| camera(i, 100, turn)).collect::<Vec<_>>();
        let photos: Vec<Camera> = (0..3).map(|i| camera(i, 400, 0.0)).collect();
        let points = [Vec3::ZERO];
        let found = corrected(&photos, &cameras(0.01), &points).unwrap();
        for (i, camera) in found.iter().enumerate() {
            assert_eq!((camera.rotation, camera.focal), (cameras(0.01)[i].rotation, photos[i].focal));
        }
        assert_eq!(corrected(&photos, &cameras(0.00001), &points), None, "the same");
        assert_eq!(corrected(&photos, &cameras(0.1), &points), None, "of other photos");
        assert_eq!(corrected(&photos, &cameras(0.01)[..2], &points), None);
    }
}
