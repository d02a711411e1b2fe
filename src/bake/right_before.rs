//! Which triangles a camera has right before it: nearer than some depth, with any part that is in its picture.
//!
//! Middles do not say: a large shard whose middle is beside the picture still fills a view. So triangles are clipped exactly.

use crate::camera::Camera;
use crate::mesh::Mesh;
use glam::{IVec3, Vec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// A triangle in more cells than this is compared with every camera.
const MOST_CELLS: i64 = 64;
/// A clipped triangle has at most a corner more for each of five planes.
const MOST_CORNERS: usize = 8;

/// The faces of `mesh` that have a part in the picture of one of `cameras`, not as deep as `depth`, in units of the scene.
pub(super) fn right_before(mesh: &Mesh, cameras: &[Camera], depth: f32) -> Vec<u32> {
    let grid = Grid::new(cameras, depth);
    let faces = (0..mesh.face_count() as u32).into_par_iter();
    faces.filter(|&face| grid.any_shows(mesh.corners(face as usize))).collect()
}

/// Whether some part of a triangle is in the picture of `camera`, and less than `depth` before it.
pub(super) fn shows(camera: &Camera, corners: [Vec3; 3], depth: f32) -> bool {
    let mut polygon = [Vec3::ZERO; MOST_CORNERS];
    for (seen, corner) in polygon.iter_mut().zip(corners) {
        *seen = camera.rotation * corner + camera.translation;
    }
    let (focal, center, size) = (camera.focal, camera.center, camera.size.as_vec2());
    // How far inside each side of the picture a point is, and how far before `depth`.
    let sides: [&dyn Fn(Vec3) -> f32; 5] = [
        &|p| depth - p.z,
        &|p| focal.x * p.x + center.x * p.z,
        &|p| (size.x - center.x) * p.z - focal.x * p.x,
        &|p| focal.y * p.y + center.y * p.z,
        &|p| (size.y - center.y) * p.z - focal.y * p.y,
    ];
    let mut count = 3;
    for side in sides {
        (polygon, count) = clipped(&polygon[..count], side);
    }
    count > 0
}

/// What of a convex polygon lies where `inside` is above zero, and how many corners that has.
fn clipped(polygon: &[Vec3], inside: &dyn Fn(Vec3) -> f32) -> ([Vec3; MOST_CORNERS], usize) {
    let (mut kept, mut count) = ([Vec3::ZERO; MOST_CORNERS], 0);
    let mut keep = |point| {
        if let Some(place) = kept.get_mut(count) {
            *place = point;
            count += 1;
        }
    };
    let next = polygon.iter().cycle().skip(1);
    for (&from, &to) in polygon.iter().zip(next) {
        let (a, b) = (inside(from), inside(to));
        if a > 0.0 {
            keep(from);
        }
        if (a > 0.0) != (b > 0.0) {
            keep(from.lerp(to, a / (a - b)));
        }
    }
    (kept, count)
}

/// Cameras by the cells that they have right before them. Of a scene's many triangles hardly any is near a camera.
struct Grid<'a> {
    cameras: &'a [Camera],
    depth: f32,
    /// Side of a cell; no camera's space is longer.
    side: f32,
    inside: HashMap<IVec3, Vec<usize>>,
}

impl<'a> Grid<'a> {
    fn new(cameras: &'a [Camera], depth: f32) -> Self {
        let spaces: Vec<[Vec3; 2]> = cameras.iter().map(|camera| space_before(camera, depth)).collect();
        let side = spaces.iter().map(|[low, high]| (*high - *low).max_element()).fold(depth, f32::max);
        let mut grid = Self { cameras, depth, side, inside: HashMap::new() };
        for (i, space) in spaces.iter().enumerate() {
            let [low, high] = space.map(|corner| grid.cell(corner));
            for cell in cells(low, high) {
                grid.inside.entry(cell).or_default().push(i);
            }
        }
        grid
    }

    fn cell(&self, point: Vec3) -> IVec3 {
        (point / self.side).floor().as_ivec3()
    }

    fn any_shows(&self, corners: [Vec3; 3]) -> bool {
        let [low, high] = bounds(&corners).map(|corner| self.cell(corner));
        let shows = |camera: &Camera| shows(camera, corners, self.depth);
        let span = high.as_i64vec3() - low.as_i64vec3() + 1;
        if span.max_element() > MOST_CELLS || span.element_product() > MOST_CELLS {
            return self.cameras.iter().any(shows);
        }
        let near = cells(low, high).filter_map(|cell| self.inside.get(&cell)).flatten();
        near.into_iter().any(|&i| shows(&self.cameras[i]))
    }
}

/// The box around the part of the picture of `camera` that is not as deep as `depth`.
fn space_before(camera: &Camera, depth: f32) -> [Vec3; 2] {
    let corners = [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(x, y)| {
        let pixel = camera.size.as_vec2() * glam::UVec2::new(x, y).as_vec2();
        let ray = ((pixel - camera.center) / camera.focal).extend(1.0);
        camera.position() + camera.rotation.transpose() * (ray * depth)
    });
    let [low, high] = bounds(&corners);
    [low.min(camera.position()), high.max(camera.position())]
}

fn bounds(points: &[Vec3]) -> [Vec3; 2] {
    points.iter().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(*p), high.max(*p)])
}

fn cells(low: IVec3, high: IVec3) -> impl Iterator<Item = IVec3> {
    let row = move |z| (low.y..=high.y).flat_map(move |y| (low.x..=high.x).map(move |x| IVec3::new(x, y, z)));
    (low.z..=high.z).flat_map(row)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{Mat3, UVec2, Vec2};

    /// At the origin, looks along z; its picture is one high and wide at depth one.
    fn camera() -> Camera {
        Camera {
            rotation: Mat3::IDENTITY,
            translation: Vec3::ZERO,
            focal: Vec2::splat(100.0),
            center: Vec2::splat(50.0),
            size: UVec2::splat(100),
        }
    }

    #[test]
    fn any_part_of_a_triangle_in_the_picture_counts() {
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        let seen = |corners: [Vec3; 3]| shows(&camera(), corners, 1.0);
        assert!(seen([at(0.0, 0.0, 0.5), at(9.0, 0.0, 0.5), at(9.0, 9.0, 0.5)]), "a corner");
        assert!(seen([at(-9.0, 0.0, 0.5), at(9.0, 0.0, 0.5), at(0.0, 90.0, 0.5)]), "an edge");
        assert!(seen([at(-9.0, -9.0, 0.5), at(9.0, -9.0, 0.5), at(0.0, 90.0, 0.5)]), "none of its points");
        assert!(seen([at(0.0, 0.0, 0.5), at(0.0, 0.0, 9.0), at(0.1, 0.0, 9.0)]), "begins before the depth");
        assert!(!seen([at(0.0, 0.0, 1.5), at(0.0, 0.0, 9.0), at(0.1, 0.0, 9.0)]), "behind the depth");
        assert!(!seen([at(9.0, 0.0, 0.5), at(9.0, 1.0, 0.5), at(9.0, 0.0, 0.9)]), "beside the picture");
        assert!(!seen([at(0.0, 0.0, -0.5), at(1.0, 0.0, -0.5), at(0.0, 1.0, -0.1)]), "behind the camera");
        // From beside the camera to far before it: in the picture only where it is deep.
        assert!(!seen([at(3.0, 0.0, 0.1), at(3.0, 1.0, 0.1), at(3.0, 0.0, 90.0)]), "enters behind the depth");
    }

    #[test]
    fn cameras_are_found_however_large_a_triangle_is() {
        let cameras: Vec<Camera> =
            (0..40).map(|i| Camera { translation: Vec3::X * -(i as f32) * 7.0, ..camera() }).collect();
        for size in [0.1, 3.0, 50.0, 1e4] {
            for at in [Vec3::new(35.0, 0.0, 0.5), Vec3::new(-size / 2.0, -size / 3.0, 0.3)] {
                let mesh =
                    Mesh { positions: vec![at, at + size * Vec3::X, at + size * Vec3::Y], ..Mesh::default() };
                let each = cameras.iter().any(|camera| shows(camera, mesh.corners(0), 1.0));
                assert!(each, "{size} {at}");
                assert_eq!(right_before(&mesh, &cameras, 1.0), [0], "{size} {at}");
            }
        }
    }
}
