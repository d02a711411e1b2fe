//! Training space, in which learning rates and epsilons mean the same for every scene.

use crate::camera::Camera;
use crate::math::lists::median;
use crate::rng::Rng;
use crate::soup::Soup;
use glam::Vec3;

/// Maximum number of pairs of a camera and a point whose depths make the unit; of more, a random
/// selection is used.
const MAX_PAIRS: usize = 200_000;
/// One seed for all scenes: runs on parts of a scene, with seeds of their own, share its space.
const SEED: u64 = 0;

/// x_training = (x_world - center) * scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SceneNormalization {
    /// The world point that is the origin of training space.
    pub center: Vec3,
    /// Training units per world unit, > 0.
    pub scale: f32,
}

impl SceneNormalization {
    /// The space of these cameras and points. Without a point in front of a camera the unit is the
    /// cameras' spread; without that it is the world's.
    pub fn new(cameras: &[Camera], points: &[Vec3]) -> Self {
        Self::of(cameras, points.len(), |i| points[i])
    }

    /// Like [`SceneNormalization::new`], for `count` points that are not in a list, because only
    /// few are used.
    pub fn of(cameras: &[Camera], count: usize, point: impl Fn(usize) -> Vec3) -> Self {
        let positions: Vec<_> = cameras.iter().map(|c| c.position().as_dvec3()).collect();
        let center = positions.iter().sum::<glam::DVec3>() / positions.len().max(1) as f64;
        let depths: Vec<f32> = pairs(cameras.len(), count)
            .filter_map(|(c, p)| Some(cameras[c].project(point(p))?.1))
            .collect();
        let spread = positions.iter().map(|p| p.distance(center)).fold(0.0, f64::max) as f32;
        let unit = median(depths, f32::total_cmp).unwrap_or(spread);
        let scale = if unit > 0.0 && unit.is_finite() { 1.0 / unit } else { 1.0 };
        Self { center: center.as_vec3(), scale }
    }

    /// A world point in training space.
    pub fn to_training(&self, world: Vec3) -> Vec3 {
        (world - self.center) * self.scale
    }

    /// A camera in training space, with the same picture of the moved scene.
    pub fn camera_to_training(&self, camera: &Camera) -> Camera {
        let translation = (camera.rotation * self.center + camera.translation) * self.scale;
        Camera { translation, ..*camera }
    }

    /// Moves a soup of training space back into the world.
    pub fn soup_to_world(&self, soup: &mut Soup) {
        let inverse = 1.0 / self.scale;
        for corner in soup.vertices.iter_mut().flatten() {
            *corner = *corner * inverse + self.center;
        }
    }

    /// Moves a soup of the world into training space.
    pub fn soup_to_training(&self, soup: &mut Soup) {
        for corner in soup.vertices.iter_mut().flatten() {
            *corner = self.to_training(*corner);
        }
    }
}

/// Pairs of a camera and a point: all of them, or [`MAX_PAIRS`] in which both are drawn
/// independently. A stride through the numbered pairs would meet only few cameras if it shared a
/// factor with their number.
fn pairs(cameras: usize, points: usize) -> impl Iterator<Item = (usize, usize)> {
    let all = cameras.saturating_mul(points);
    let camera = Rng::new(SEED, "space camera", 0);
    let point = Rng::new(SEED, "space point", 0);
    let below = |random: u64, count: usize| (random % count as u64) as usize;
    (0..all.min(MAX_PAIRS)).map(move |i| {
        if all <= MAX_PAIRS {
            (i % cameras, i / cameras)
        } else {
            (below(camera.bits(i as u64), cameras), below(point.bits(i as u64), points))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2};

    fn camera(position: Vec3) -> Camera {
        Camera {
            rotation: Mat3::IDENTITY,
            translation: -position,
            focal: Vec2::splat(100.0),
            center: Vec2::splat(50.0),
            size: UVec2::splat(100),
        }
    }

    #[test]
    fn a_moved_and_scaled_scene_trains_in_the_same_space() {
        let points: Vec<Vec3> = (0..50)
            .map(|i| Vec3::new((i % 5) as f32 * 0.1, (i % 7) as f32 * 0.1, 3.0 + i as f32 * 0.01))
            .collect();
        let base = SceneNormalization::new(&[camera(Vec3::ZERO), camera(Vec3::X)], &points);
        for (shift, scale) in
            [(Vec3::ZERO, 1e4f32), (Vec3::new(100.0, -50.0, 20.0), 1e-4), (Vec3::Y * 7.0, 3.0)]
        {
            let shift = shift * scale;
            let place = |p: Vec3| p * scale + shift;
            let moved: Vec<Vec3> = points.iter().map(|&p| place(p)).collect();
            let space = SceneNormalization::new(
                &[camera(place(Vec3::ZERO)), camera(place(Vec3::X))],
                &moved,
            );
            for (a, b) in points.iter().zip(&moved) {
                assert!(base.to_training(*a).distance(space.to_training(*b)) < 2e-4);
            }
        }
    }

    #[test]
    fn the_unit_is_taken_from_all_cameras() {
        // Sizes at which a stride through the pairs met 2, 1, 2 and 4 of the cameras.
        for (cameras, points) in [(90, 100_000), (15, 200_000), (34, 100_000), (300, 20_000)] {
            let mut times = vec![0u32; cameras];
            for (camera, _) in pairs(cameras, points) {
                times[camera] += 1;
            }
            let even = MAX_PAIRS as u32 / cameras as u32;
            assert!(
                times.iter().all(|&n| n > even / 2 && n < 2 * even),
                "{cameras} cameras: {times:?}"
            );
        }
        // One camera in three stands three times as far away: the median is that of the others.
        let cameras: Vec<Camera> =
            (0..90).map(|i| camera(Vec3::Z * if i % 3 == 0 { -2.0 } else { 0.0 })).collect();
        let space = SceneNormalization::new(&cameras, &vec![Vec3::Z; 100_000]);
        assert_eq!(space.scale, 1.0);
        assert_eq!(pairs(7, 3).collect::<std::collections::HashSet<_>>().len(), 21);
        assert_eq!(pairs(0, 5).count() + pairs(5, 0).count(), 0);
    }

    #[test]
    fn a_lone_camera_without_points_keeps_the_worlds_unit() {
        let space = SceneNormalization::new(&[camera(Vec3::new(5.0, 0.0, 0.0))], &[]);
        assert_eq!(space, SceneNormalization { center: Vec3::new(5.0, 0.0, 0.0), scale: 1.0 });
    }

    #[test]
    fn leaving_undoes_entering() {
        let space = SceneNormalization { center: Vec3::new(1.0, 2.0, 3.0), scale: 0.25 };
        let corners = [Vec3::X, Vec3::Y, Vec3::new(9.0, -4.0, 2.0)];
        let mut soup = Soup { vertices: vec![corners], ..Soup::default() };
        space.soup_to_training(&mut soup);
        space.soup_to_world(&mut soup);
        assert!(soup.vertices[0].iter().zip(&corners).all(|(a, b)| a.distance(*b) < 1e-6));
    }
}
