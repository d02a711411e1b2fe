//! Cameras on a circle around a scene.

use crate::camera::{self, Camera, Viewpoint};
use crate::scene::Scene;
use glam::{UVec2, Vec2, Vec3};
use std::f32::consts::TAU;

/// `count` cameras on a circle around what `cameras` look at, at their median height and distance; the circle
/// begins beside the first of them. Empty when there are no cameras.
pub fn around_cameras(cameras: &[Camera], count: u32) -> Vec<Camera> {
    let Some(first) = cameras.first() else { return Vec::new() };
    let up = cameras.iter().map(|c| -c.rotation.row(1)).sum::<Vec3>().normalize_or(Vec3::NEG_Y);
    let positions: Vec<Vec3> = cameras.iter().map(Camera::position).collect();
    let target = camera::focus(cameras.iter()).unwrap_or_else(|| ahead(cameras, &positions));
    let heights = positions.iter().map(|p| (*p - target).dot(up));
    let height = median(heights.collect());
    let radius = median(positions.iter().map(|p| (*p - target).reject_from(up).length()).collect());
    let start = (positions[0] - target).reject_from(up);
    circle(first, Circle { target, up, height, radius, start }, count)
}

/// `count` cameras of `width` px on the circle that begins at `viewpoint` and goes around what it looks at. `up` is the
/// axis that points up.
pub fn around_viewpoint(viewpoint: &Viewpoint, up: Vec3, width: u32, count: u32) -> Vec<Camera> {
    let camera = viewpoint.camera(UVec2::new(width, (width * 3 / 4).max(1)));
    let target = glam::DVec3::from(viewpoint.target).as_vec3();
    let from = camera.position() - target;
    let (height, start) = (from.dot(up), from.reject_from(up));
    circle(&camera, Circle { target, up, height, radius: start.length(), start }, count)
}

/// `count` cameras of `width` px on a circle around the middle of a scene, looking down a little.
/// `up` is the axis that points up. Empty when the scene is.
pub fn around_scene(scene: &Scene, up: Vec3, width: u32, count: u32) -> Vec<Camera> {
    let centers = centers(scene);
    if centers.is_empty() {
        return Vec::new();
    }
    let target = Vec3::from_array([0, 1, 2].map(|axis| median(centers.iter().map(|c| c[axis]).collect())));
    // Half of a trained scene is the thing itself, the rest its surroundings.
    let extent = median(centers.iter().map(|c| c.distance(target)).collect());
    let size = UVec2::new(width, (width * 3 / 4).max(1));
    let camera = Camera {
        rotation: glam::Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(size.x as f32),
        center: size.as_vec2() / 2.0,
        size,
    };
    let start = up.any_orthonormal_vector();
    let distance = if extent > 0.0 { 3.0 * extent } else { 1.0 };
    circle(&camera, Circle { target, up, height: 0.4 * distance, radius: 0.9 * distance, start }, count)
}

/// The middle of every triangle.
fn centers(scene: &Scene) -> Vec<Vec3> {
    let center = |t: [Vec3; 3]| (t[0] + t[1] + t[2]) / 3.0;
    match scene {
        Scene::Soup(soup) => soup.vertices.iter().map(|t| center(*t)).collect(),
        Scene::Mesh(mesh) => (0..mesh.face_count()).map(|face| center(mesh.corners(face))).collect(),
    }
}

struct Circle {
    target: Vec3,
    up: Vec3,
    height: f32,
    radius: f32,
    /// Direction of the first camera, at right angles to `up`.
    start: Vec3,
}

fn circle(camera: &Camera, circle: Circle, count: u32) -> Vec<Camera> {
    let Circle { target, up, height, radius, start } = circle;
    let x = start.try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let y = up.cross(x);
    let place = |k: u32| {
        let (sin, cos) = (TAU * k as f32 / count as f32).sin_cos();
        camera.looking(target + up * height + (x * cos + y * sin) * radius, target, up)
    };
    (0..count).map(place).collect()
}

/// A point in front of cameras whose axes do not meet, at twice their mean distance from their centre.
fn ahead(cameras: &[Camera], positions: &[Vec3]) -> Vec3 {
    let middle = positions.iter().sum::<Vec3>() / positions.len() as f32;
    let forward = cameras.iter().map(|c| c.rotation.row(2)).sum::<Vec3>().normalize_or(Vec3::Z);
    let spread = median(positions.iter().map(|p| p.distance(middle)).collect());
    middle + forward * if spread > 0.0 { 2.0 * spread } else { 1.0 }
}

/// The middle value; 0 of none.
fn median(values: Vec<f32>) -> f32 {
    crate::math::median::median(values, f32::total_cmp).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::Mesh;
    use crate::soup::Soup;
    use glam::Mat3;

    #[test]
    fn an_orbit_looks_at_what_the_photos_look_at() {
        let camera = Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::splat(90.0),
            center: Vec2::new(60.0, 40.0),
            size: UVec2::new(120, 80),
        };
        let target = Vec3::new(2.0, -1.0, 5.0);
        let positions =
            [0.0, 0.8, 1.9, 3.0, 5.5].map(|a: f32| target + Vec3::new(4.0 * a.cos(), -1.5, 4.0 * a.sin()));
        let cameras = positions.map(|position| camera.looking(position, target, Vec3::NEG_Y));
        let orbit = around_cameras(&cameras, 12);
        assert_eq!(orbit.len(), 12);
        assert!(orbit[0].position().distance(positions[0]) < 0.2, "begins beside the first photo");
        for camera in &orbit {
            let seen = camera.rotation * target + camera.translation;
            assert!(seen.truncate().length() < 0.2 * seen.z && seen.z > 3.0, "{seen}");
            assert!((camera.position() - target).length() - 4.27 < 0.3);
            assert_eq!((camera.focal, camera.size), (Vec2::splat(90.0), UVec2::new(120, 80)));
        }
        assert_eq!(around_cameras(&[], 3), []);
        assert!(
            around_cameras(&[camera; 2], 3)
                .iter()
                .all(|c| c.validate(&crate::limits::Limits::DEFAULT).is_ok()),
            "parallel axes"
        );
    }

    #[test]
    fn an_orbit_of_a_viewpoint_begins_there() {
        let viewpoint =
            Viewpoint { eye: [3.0, 2.0, 1.0], target: [1.0, 0.5, 0.0], up: [0.0, 1.0, 0.0], fov: 60.0 };
        let orbit = around_viewpoint(&viewpoint, Vec3::Y, 400, 4);
        assert_eq!((orbit.len(), orbit[0].size), (4, UVec2::new(400, 300)));
        assert!(orbit[0].position().distance(Vec3::new(3.0, 2.0, 1.0)) < 1e-5);
        assert!(orbit[2].position().distance(Vec3::new(-1.0, 2.0, -1.0)) < 1e-5, "opposite, as high");
        assert!(orbit.iter().all(|c| (c.rotation * Vec3::Y).x.abs() < 1e-6), "the horizon is level");
    }

    #[test]
    fn an_orbit_around_a_scene_has_it_in_view() {
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        let triangle = |o: Vec3| [o, o + Vec3::X * 0.1, o + Vec3::Y * 0.1];
        let vertices: Vec<_> =
            (0..27).map(|i| triangle(at((i % 3) as f32, (i / 3 % 3) as f32, (i / 9) as f32))).collect();
        let scene = Scene::Soup(Soup { vertices, ..Soup::default() });
        for camera in around_scene(&scene, Vec3::Z, 64, 7) {
            let seen = camera.rotation * at(1.0, 1.0, 1.0) + camera.translation;
            assert!(seen.z > 1.0 && seen.truncate().length() < 0.2 * seen.z);
            assert!(camera.position().z > 1.0, "from above");
        }
        assert_eq!(around_scene(&Scene::Mesh(Mesh::default()), Vec3::Z, 64, 7), []);
    }
}
