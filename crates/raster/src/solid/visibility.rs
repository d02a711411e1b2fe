//! The face and depth that every sample sees, of all faces or of each of some planes, and the
//! barycentric coordinates there.

use super::bin::{STRIDE, SampleKey, SampleKeys, face_of};
use super::projector::Projector;
use glam::{DVec3, UVec2, Vec2, Vec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::Mesh;

/// The face number of an empty sample.
pub const NO_FACE: u32 = u32::MAX;

/// The face of each sample. `[height * width]`, row by row, in samples
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Visibility {
    /// Width and height, samples: the camera's size times the samples along an axis.
    pub size: UVec2,
    /// Face seen, or [`NO_FACE`].
    pub face: Vec<u32>,
    /// Depth z in the camera's frame, units of the mesh; infinite for empty samples.
    pub depth: Vec<f32>,
}

/// Perspective-correct barycentric coordinates of many samples of few faces.
#[derive(Debug, Clone)]
pub struct Barycentrics<'a> {
    mesh: &'a Mesh,
    projector: Projector,
}

impl<'a> Barycentrics<'a> {
    /// For a mesh and camera with `samples` samples along each axis of a pixel.
    pub fn new(mesh: &'a Mesh, camera: &Camera, samples: u32) -> Self {
        Self { mesh, projector: Projector::new(camera, samples, 0.0) }
    }

    /// The values of a face for [`Barycentrics::weights`].
    pub fn face(&self, face: u32) -> FaceBarycentrics {
        FaceBarycentrics::new(&self.projector, self.mesh.corners(face as usize))
    }

    /// Perspective-correct weights of a face's corners at a sample; in [0, 1], sum 1.
    #[inline(always)]
    pub fn weights(&self, face: &FaceBarycentrics, x: u32, y: u32) -> [f32; 3] {
        face.weights(self.projector.ray(x, y))
    }
}

/// The values of a face for barycentric coordinates.
#[derive(Debug, Clone, Copy)]
pub struct FaceBarycentrics {
    /// Corner i's weight is proportional to the dot product of the i-th vector and the ray.
    opposite: [DVec3; 3],
}

impl FaceBarycentrics {
    pub(super) fn new(projector: &Projector, corners: [Vec3; 3]) -> Self {
        let [a, b, c] = corners.map(|v| projector.to_camera_f64(v));
        Self { opposite: [b.cross(c), c.cross(a), a.cross(b)] }
    }

    /// Interpolates values of corners where a ray meets the face's plane, within the face or beyond
    /// it.
    pub(super) fn mixed(&self, ray: DVec3, of_corners: &[Vec2; 3]) -> Vec2 {
        let parts = self.opposite.map(|n| n.dot(ray));
        let per = 1.0 / (parts[0] + parts[1] + parts[2]);
        let mix = |k: usize| of_corners[k].as_dvec2() * (parts[k] * per);
        (mix(0) + mix(1) + mix(2)).as_vec2()
    }

    /// The same within the face.
    pub(super) fn inside(&self, ray: DVec3, of_corners: &[Vec2; 3]) -> Vec2 {
        let weights = self.weights(ray);
        of_corners[0] * weights[0] + of_corners[1] * weights[1] + of_corners[2] * weights[2]
    }

    /// Weights of the corners where a ray meets the face's plane; at least 0, sum 1.
    #[inline(always)]
    fn weights(&self, ray: DVec3) -> [f32; 3] {
        let parts = self.opposite.map(|n| n.dot(ray));
        let per = 1.0 / (parts[0] + parts[1] + parts[2]);
        // Snapping moved the corners, so a sample may lie slightly outside.
        let kept = parts.map(|p| (p * per).max(0.0));
        let sum = kept[0] + kept[1] + kept[2];
        if !(sum > 0.0 && sum.is_finite()) {
            return [1.0 / 3.0; 3];
        }
        kept.map(|p| (p / sum) as f32)
    }
}

/// The nearest face of a set at a sample. The greater of two is nearer; at the same depth it has
/// the lower face index.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Nearest(SampleKey);

impl Nearest {
    /// No face at all: farther than any.
    pub const NONE: Self = Self(0);

    /// The nearest and the second nearest of four.
    #[inline(always)]
    pub fn two_of([a, b, c, d]: [Self; 4]) -> [Self; 2] {
        let near = [a.max(b), c.max(d)];
        let far = [a.min(b), c.min(d)];
        [near[0].max(near[1]), near[0].min(near[1]).max(far[0]).max(far[1])]
    }

    /// The face, or `NO_FACE`.
    #[inline(always)]
    pub fn face(self) -> u32 {
        face_of(self.0)
    }
}

/// The samples of one tile, plane by plane.
#[derive(Debug)]
pub struct PlaneTile<'a> {
    pub(super) keys: &'a [SampleKeys],
    /// Its first sample in the picture.
    pub corner: UVec2,
    /// Its samples across and down.
    pub size: UVec2,
}

impl PlaneTile<'_> {
    /// The nearest face of a plane at sample `x`, `y` of the tile.
    #[inline(always)]
    pub fn nearest(&self, plane: usize, x: u32, y: u32) -> Nearest {
        Nearest(self.keys[plane][y as usize * STRIDE + x as usize])
    }
}

#[cfg(test)]
mod tests {
    use super::super::{SolidRasterOptions, SolidRasterizer};
    use super::*;
    use glam::{Mat3, Vec2, Vec3};
    use std::sync::Mutex;
    use trisplat_scene::Rng;

    /// Triangles of all sizes that hide each other.
    fn mesh(faces: u64) -> Mesh {
        let rng = Rng::new(3, "planes", 0);
        let point = |i: u64| Vec3::from([0, 1, 2].map(|k| rng.uniform(3 * i + k) * 2.0 - 1.0));
        let corner = |i: u64| {
            let reach = if (i / 3).is_multiple_of(7) { 1.5 } else { 0.1 };
            point(i / 3) * 1.5 + Vec3::Z * 3.0 + reach * point(i + 10_000)
        };
        Mesh { positions: (0..3 * faces).map(corner).collect(), ..Mesh::default() }
    }

    #[test]
    fn the_nearest_of_some_planes_is_what_their_faces_look_like() {
        let size = UVec2::new(150, 70);
        let center = size.as_vec2() / 2.0;
        let rotation = Mat3::IDENTITY;
        let translation = Vec3::ZERO;
        let camera = Camera { rotation, translation, focal: Vec2::splat(60.0), center, size };
        let mesh = mesh(600);
        let options = SolidRasterOptions::default();
        let plane_of: Vec<u8> = (0..600).map(|f| (f * f % 3) as u8).collect();
        let pixels = size.x as usize * size.y as usize;
        for some in [&[0, 1, 2][..], &[0, 2], &[1]] {
            let drawn = Mutex::new(vec![0; pixels]);
            SolidRasterizer::new().planes(&mesh, &camera, &options, (3, &plane_of), |tile| {
                let mut drawn = drawn.lock().unwrap();
                for (x, y) in (0..tile.size.y).flat_map(|y| (0..tile.size.x).map(move |x| (x, y))) {
                    let nearest = some
                        .iter()
                        .map(|p| tile.nearest(*p, x, y))
                        .fold(Nearest::NONE, Nearest::max);
                    drawn[((tile.corner.y + y) * size.x + tile.corner.x + x) as usize] =
                        nearest.face();
                }
            });
            let kept: Vec<u32> =
                (0..600).filter(|f| some.contains(&plane_of[*f as usize].into())).collect();
            let mut part = Mesh { positions: Vec::new(), ..Mesh::default() };
            part.positions.extend(kept.iter().flat_map(|f| mesh.corners(*f as usize)));
            let mut alone =
                SolidRasterizer::new().visibility(&part, &camera, &options).face.clone();
            let seen = alone.iter_mut().filter(|face| **face != super::super::NO_FACE);
            assert!(seen.map(|face| *face = kept[*face as usize]).count() > pixels / 4);
            assert!(*drawn.lock().unwrap() == alone, "{some:?}");
        }
    }
}
