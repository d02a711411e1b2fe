//! How large triangles appear in the photos that see them.

use crate::views::Views;
use glam::Vec3;
use trisplat_raster::solid::{NO_FACE, SolidRasterizer};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;
use trisplat_scene::parallel::{self, GRAIN};

/// Longer side of the pictures that say which triangles each photo sees, px. Triangles with less than a pixel there hardly need texels.
const LONGEST: u32 = 1280;

/// The mean length of every face's three edges in the photos that see it, px: from corner 0 to 1, 1 to 2, 2 to 0. Zeros where no
/// photo does. `[F]`
pub(super) fn footprints(mesh: &Mesh, views: &Views) -> Vec<[f32; 3]> {
    let drawing = views.drawing(mesh, 1);
    let mut solid = SolidRasterizer::new();
    // Sums of three lengths, and how many.
    let mut lengths = vec![[0.0f32; 4]; mesh.face_count()];
    let mut seen = vec![false; mesh.face_count()];
    for camera in views.cameras() {
        seen.fill(false);
        let visible = solid.visibility(mesh, &camera.within(LONGEST), &drawing);
        visible.face.iter().filter(|face| **face != NO_FACE).for_each(|face| seen[*face as usize] = true);
        parallel::for_each_mut(&mut lengths, GRAIN, |face, lengths| {
            if seen[face] {
                let here = edges(mesh.corners(face), camera, drawing.near);
                (0..3).for_each(|i| lengths[i] += here[i]);
                lengths[3] += 1.0;
            }
        });
    }
    lengths.iter().map(|sums| [0, 1, 2].map(|i| sums[i] / sums[3].max(1.0))).collect()
}

/// Lengths of the edges of a triangle in a picture, px. Of one that begins behind the camera the length that it would have in its middle.
fn edges(corners: [Vec3; 3], camera: &Camera, near: f32) -> [f32; 3] {
    let corners = corners.map(|v| camera.rotation * v + camera.translation);
    let length = |p: Vec3, q: Vec3| {
        if p.z > near && q.z > near {
            let at = |v: Vec3| v.truncate() / v.z * camera.focal;
            return at(p).distance(at(q));
        }
        p.distance(q) / ((p.z + q.z) / 2.0).max(near) * camera.focal.max_element()
    };
    let [a, b, c] = corners;
    [length(a, b), length(b, c), length(c, a)]
}
