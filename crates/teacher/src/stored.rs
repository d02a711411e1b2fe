//! The cameras that a scene stores, and cameras between them.

use glam::{Mat3, Quat};
use std::collections::HashSet;
use trisplat_scene::camera::Camera;

/// Cameras are only averaged with one of their nearest neighbours, because a wall may be between distant
/// ones.
const NEIGHBOURS: usize = 2;
/// Views with a larger angle do not show the same surface; cosine of the angle.
const MIN_COSINE: f32 = 0.5;

/// The cameras themselves, then those half way to each one's nearest neighbours, up to the limit.
pub(super) fn viewpoints(cameras: &[Camera], max_bytes: u64) -> Vec<Camera> {
    let mut left = max_bytes.saturating_sub(cameras.iter().map(picture_bytes).sum());
    let mut fits = |camera: &Camera| {
        let needed = picture_bytes(camera);
        let fits = needed <= left;
        left -= if fits { needed } else { 0 };
        fits
    };
    [cameras.to_vec(), between(cameras).into_iter().filter(|camera| fits(camera)).collect()].concat()
}

/// Bytes of the 8-bit picture that a camera takes.
pub(super) fn picture_bytes(camera: &Camera) -> u64 {
    3 * u64::from(camera.size.x) * u64::from(camera.size.y)
}

/// Cameras half way from each of `cameras` to its nearest neighbours; those to the very nearest come first.
pub(super) fn between(cameras: &[Camera]) -> Vec<Camera> {
    // A pair of mutual neighbours has one middle.
    let mut seen = HashSet::new();
    let pairs = (0..NEIGHBOURS).flat_map(|rank| (0..cameras.len()).map(move |i| (rank, i)));
    let middle = |(rank, i): (usize, usize)| {
        let other = neighbour(cameras, i, rank)?;
        seen.insert((i.min(other), i.max(other))).then(|| middle(&cameras[i], &cameras[other]))
    };
    pairs.filter_map(middle).collect()
}

/// The `rank`-th nearest camera to camera `i` with a similar direction.
fn neighbour(cameras: &[Camera], i: usize, rank: usize) -> Option<usize> {
    let (position, forward) = (cameras[i].position(), cameras[i].rotation.row(2));
    let alike = |j: &usize| *j != i && cameras[*j].rotation.row(2).dot(forward) >= MIN_COSINE;
    let mut others: Vec<usize> = (0..cameras.len()).filter(alike).collect();
    let distance = |j: &usize| cameras[*j].position().distance_squared(position);
    others.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
    others.get(rank).copied()
}

/// A camera half way between two, with the lens of the first.
fn middle(a: &Camera, b: &Camera) -> Camera {
    let rotation = Mat3::from_quat(Quat::from_mat3(&a.rotation).slerp(Quat::from_mat3(&b.rotation), 0.5));
    let position = (a.position() + b.position()) / 2.0;
    Camera { rotation, translation: -(rotation * position), ..*a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{UVec2, Vec2, Vec3};

    /// Cameras on a line that look ahead, one step apart, and a last one that looks back.
    fn line(count: usize) -> Vec<Camera> {
        let camera = |i: usize| Camera {
            rotation: if i + 1 == count {
                Mat3::from_rotation_y(std::f32::consts::PI)
            } else {
                Mat3::IDENTITY
            },
            translation: Vec3::X * -(i as f32),
            focal: Vec2::splat(10.0),
            center: Vec2::splat(5.0),
            size: UVec2::splat(10),
        };
        (0..count).map(camera).collect()
    }

    #[test]
    fn pictures_lie_between_neighbours_that_look_the_same_way() {
        let cameras = line(5);
        let all = viewpoints(&cameras, u64::MAX);
        assert_eq!(all[..5], cameras[..]);
        let mut between: Vec<f32> = all[5..].iter().map(|camera| camera.position().x).collect();
        between.sort_by(f32::total_cmp);
        // Nearest neighbours one step apart, and at the ends two; none beside the one that looks back.
        assert_eq!(between, [0.5, 1.0, 1.5, 2.0, 2.5]);
        assert!(all[5..].iter().all(|camera| camera.validate(&trisplat_scene::Limits::DEFAULT).is_ok()));
    }

    #[test]
    fn no_more_pictures_than_fit() {
        let cameras = line(5);
        assert_eq!(viewpoints(&cameras, 7 * 300).len(), 7);
        assert_eq!(viewpoints(&cameras, 0).len(), 5, "its own cameras always");
    }
}
