//! Cameras on a circle around a scene.

use glam::{DVec3, UVec2, Vec2, Vec3};
use std::f32::consts::TAU;
use trisplat_raster::framing::camera_holding;
use trisplat_scene::{
    Scene,
    camera::{Camera, Viewpoint},
};

/// Largest radius of an orbit, as a share of the distance to the walls or shell that close a scene.
const ROOM: f32 = 0.9;

/// `count` cameras for pictures of `size` on the circle that begins at `viewpoint` and goes around its subject. All of the
/// subject stays in the picture. `up` is the axis that points up; `room` gives the distance from the target at which something closes
/// the scene in a direction: a camera behind that moves closer.
pub fn around_viewpoint(
    viewpoint: &Viewpoint,
    up: Vec3,
    room: &dyn Fn(Vec3) -> f32,
    size: UVec2,
    count: u32,
) -> Vec<Camera> {
    let target = DVec3::from(viewpoint.target).as_vec3();
    let from = DVec3::from(viewpoint.eye).as_vec3() - target;
    let (height, start) = (from.dot(up), from.reject_from(up));
    let any = camera_holding(viewpoint, size);
    let within = |on_circle: Camera| {
        let away = on_circle.position() - target;
        let way = away.normalize_or(up.any_orthonormal_vector());
        let eye = target + way * away.length().min(ROOM * room(way));
        let held = Viewpoint { eye: eye.as_dvec3().to_array(), ..*viewpoint };
        camera_holding(&held, size).looking(eye, target, up)
    };
    let circle = circle(&any, Circle { target, up, height, radius: start.length(), start }, count);
    circle.into_iter().map(within).collect()
}

/// `count` cameras of `width` px on a circle around the middle of a scene, looking down a little.
/// `up` is the axis that points up. Empty when the scene is.
pub fn around_scene(scene: &Scene, up: Vec3, width: u32, count: u32) -> Vec<Camera> {
    let centers = centers(scene);
    if centers.is_empty() {
        return Vec::new();
    }
    let target = Vec3::from_array([0, 1, 2].map(|axis| median(centers.iter().map(|c| c[axis]).collect())));
    // Half of a trained scene is its subject, the rest its surroundings.
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

/// The middle value; 0 of none.
fn median(values: Vec<f32>) -> f32 {
    trisplat_scene::math::median::median(values, f32::total_cmp).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use trisplat_scene::Soup;
    use trisplat_scene::mesh::Mesh;

    const VIEWPOINT: Viewpoint = Viewpoint {
        eye: [3.0, 2.0, 1.0],
        target: [1.0, 0.5, 0.0],
        up: [0.0, 1.0, 0.0],
        fov: 60.0,
        radius: None,
        orbit: None,
    };

    #[test]
    fn an_orbit_of_a_viewpoint_begins_there() {
        let orbit = around_viewpoint(&VIEWPOINT, Vec3::Y, &|_| f32::INFINITY, UVec2::new(400, 300), 4);
        assert_eq!((orbit.len(), orbit[0].size), (4, UVec2::new(400, 300)));
        assert!(orbit[0].position().distance(Vec3::new(3.0, 2.0, 1.0)) < 1e-5);
        assert!(orbit[2].position().distance(Vec3::new(-1.0, 2.0, -1.0)) < 1e-5, "opposite, as high");
        assert!(orbit.iter().all(|c| (c.rotation * Vec3::Y).x.abs() < 1e-6), "the horizon is level");
    }

    #[test]
    fn an_orbit_keeps_the_subject_in_the_picture_and_stays_inside_the_shell() {
        let (target, radius) = (Vec3::new(1.0, 0.5, 0.0), 0.8);
        let viewpoint = Viewpoint { radius: Some(0.8), fov: 20.0, ..VIEWPOINT };
        for (room, size) in [(f32::INFINITY, UVec2::new(400, 300)), (1.5, UVec2::new(150, 300))] {
            for camera in around_viewpoint(&viewpoint, Vec3::Y, &|_| room, size, 9) {
                assert!(camera.position().distance(target) <= 0.91 * room);
                for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
                    let inside = |p: Vec3| camera.frames(p);
                    assert!(
                        inside(target + 0.7 * radius * axis) && inside(target - 0.7 * radius * axis),
                        "{room} {size}"
                    );
                }
            }
        }
    }

    #[test]
    fn a_wall_behind_the_subject_brings_only_the_cameras_there_nearer() {
        // A subject on a wall: behind it there is half a unit of room.
        let room = |way: Vec3| if way.x < 0.0 { 0.5 } else { 9.0 };
        let orbit = around_viewpoint(&VIEWPOINT, Vec3::Y, &room, UVec2::new(400, 300), 4);
        let away: Vec<f32> =
            orbit.iter().map(|camera| camera.position().distance(Vec3::new(1.0, 0.5, 0.0))).collect();
        assert!((away[0] - 7.25_f32.sqrt()).abs() < 1e-5 && (away[2] - 0.45).abs() < 1e-5, "{away:?}");
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
