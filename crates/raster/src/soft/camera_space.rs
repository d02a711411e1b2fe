//! World triangles in camera space, clipped at the near plane.

use crate::kernel::clip::{self, Piece, PieceCorner};
use crate::kernel::splat::CameraTriangle;
use glam::{Mat3, Vec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::vec::{V2, V3};

/// A camera in the kernels' types.
#[derive(Debug, Clone, Copy)]
pub(super) struct KernelCamera {
    pub(super) rotation: Mat3,
    pub(super) translation: Vec3,
    pub(super) position: Vec3,
    pub(super) focal: V2<f32>,
    pub(super) center: V2<f32>,
    pub(super) size: [f32; 2],
}

impl KernelCamera {
    pub(super) fn new(camera: &Camera) -> Self {
        Self {
            rotation: camera.rotation,
            translation: camera.translation,
            position: camera.position(),
            focal: V2::new(camera.focal.x, camera.focal.y),
            center: V2::new(camera.center.x, camera.center.y),
            size: camera.size.as_vec2().to_array(),
        }
    }
}

#[inline]
pub(super) fn v3(v: Vec3) -> V3<f32> {
    V3::new(v.x, v.y, v.z)
}

#[inline]
pub(super) fn vec3(v: V3<f32>) -> Vec3 {
    Vec3::new(v.x, v.y, v.z)
}

/// A triangle in camera space before it is clipped at the near plane.
pub(super) struct UnclippedTriangle {
    pub(super) whole: CameraTriangle<f32>,
    pub(super) corners: [V3<f32>; 3],
}

impl UnclippedTriangle {
    #[inline]
    pub(super) fn new(camera: &KernelCamera, [v0, v1, v2]: &[Vec3; 3]) -> Self {
        let first = v3(camera.rotation * *v0 + camera.translation);
        let edges = [v3(camera.rotation * (*v1 - *v0)), v3(camera.rotation * (*v2 - *v0))];
        Self { whole: CameraTriangle { first, edges }, corners: [first, first + edges[0], first + edges[1]] }
    }

    #[inline]
    fn corner(&self, corner: PieceCorner, near: f32) -> V3<f32> {
        let (from, to) = (self.corners[corner.from as usize], self.corners[corner.to as usize]);
        if corner.from == corner.to { from } else { clip::near_point(from, to, near) }
    }

    /// One of its pieces in front of the near plane.
    #[inline]
    pub(super) fn piece(&self, piece: &Piece, near: f32) -> CameraTriangle<f32> {
        if *piece == clip::WHOLE {
            return self.whole;
        }
        let [a, b, c] = piece.map(|corner| self.corner(corner, near));
        CameraTriangle { first: a, edges: [b - a, c - a] }
    }
}

/// Unit direction from the camera to a triangle's centroid, and the distance.
#[inline]
pub(super) fn direction(camera: &KernelCamera, [v0, v1, v2]: &[Vec3; 3]) -> (V3<f32>, f32) {
    let offset = (*v0 - camera.position) + ((*v1 - *v0) + (*v2 - *v0)) * (1.0 / 3.0);
    let size = offset.abs().max_element();
    // The squares of much smaller or larger numbers leave the range of f32.
    let usual = (1e-15..1e15).contains(&size);
    let length = if usual || size == 0.0 { offset.length() } else { (offset / size).length() * size };
    let unit = if length > 0.0 { offset / length } else { Vec3::Z };
    (v3(unit), length)
}
