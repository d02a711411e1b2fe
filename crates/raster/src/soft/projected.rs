//! The splats of a frame: their triangles in camera space, clipped at the near plane; first in the
//! order of the triangles, then by depth.

use crate::kernel::splat::{self, CameraTriangle, DepthPlane, Piece, PieceCorner};
use glam::{Mat3, Vec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::math::lanes::{LANES, Lanes};
use trisplat_scene::math::real::{V2, V3};

/// Triangles that one task projects; also the unit of the gradient gather.
pub(super) const CHUNK: usize = 1024;

/// Records are prefetched this many splats ahead.
pub(super) const PREFETCH_AHEAD: usize = 6;

/// A splat's record for pixels: one cache line. With `Window::Coverage` `edge` and `shift` are in
/// widths of its ramp and `floor` is the smallest coverage drawn; else they are in inradii, and the
/// smallest ratio.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(super) struct SplatRecord {
    pub(super) origin: [f32; 2],
    pub(super) edge: [[f32; 2]; 3],
    pub(super) shift: f32,
    pub(super) floor: f32,
    pub(super) sigma: f32,
    pub(super) log2_opacity: f32,
    pub(super) rgb: [f32; 3],
    pub(super) triangle: u32,
}

/// Box of the drawn region, px.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ScreenBox {
    pub(super) lo: [f32; 2],
    pub(super) hi: [f32; 2],
}

/// A splat before the sort.
#[derive(Debug, Clone, Copy)]
pub(super) struct ProjectedSplat {
    pub(super) record: SplatRecord,
    pub(super) bounds: ScreenBox,
    pub(super) plane: DepthPlane<f32>,
    pub(super) piece: Piece,
    /// Largest distance of a corner from the centroid, px.
    pub(super) radius_px: f32,
    /// Its index after the sort.
    pub(super) rank: u32,
}

/// The splats of one chunk of triangles, in the triangles' order.
#[derive(Debug, Default)]
pub(super) struct SplatChunk {
    pub(super) projected: Vec<ProjectedSplat>,
    /// Bits of their depths.
    pub(super) depths: Vec<u32>,
}

/// The splats in depth order, as parallel arrays.
#[derive(Debug, Default)]
pub(super) struct ProjectedTriangles {
    pub(super) records: Vec<SplatRecord>,
    pub(super) bounds: Vec<ScreenBox>,
    pub(super) planes: Vec<DepthPlane<f32>>,
}

/// All splats of a frame.
#[derive(Debug, Default)]
pub(super) struct ProjectedScene {
    pub(super) chunks: Vec<SplatChunk>,
    pub(super) splats: ProjectedTriangles,
    /// Triangles of the soup.
    pub(super) triangles: usize,
    pub(super) keys: Vec<DepthKey>,
    pub(super) scratch: Vec<DepthKey>,
}

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
        Self {
            whole: CameraTriangle { first, edges },
            corners: [first, first + edges[0], first + edges[1]],
        }
    }

    #[inline]
    fn corner(&self, corner: PieceCorner, near: f32) -> V3<f32> {
        let from = self.corners[corner.from as usize];
        let to = self.corners[corner.to as usize];
        if corner.from == corner.to { from } else { splat::near_point(from, to, near) }
    }

    /// One of its pieces in front of the near plane.
    #[inline]
    pub(super) fn piece(&self, piece: &Piece, near: f32) -> CameraTriangle<f32> {
        if *piece == splat::WHOLE {
            return self.whole;
        }
        let [a, b, c] = piece.map(|corner| self.corner(corner, near));
        CameraTriangle { first: a, edges: [b - a, c - a] }
    }
}

/// `N` numbers of each of sixteen splats, number by number.
pub(super) type Columns<const N: usize> = [[f32; LANES]; N];

/// The columns of `values`.
#[inline(always)]
pub(super) fn columns<L: Lanes, const N: usize>(values: [L; N]) -> Columns<N> {
    let mut out = [[0.0; LANES]; N];
    for (value, column) in values.iter().zip(&mut out) {
        value.store(column);
    }
    out
}

/// The numbers of one splat.
#[inline(always)]
pub(super) fn numbers<const N: usize>(columns: &Columns<N>, lane: usize) -> [f32; N] {
    let mut out = [0.0; N];
    for (number, column) in out.iter_mut().zip(columns) {
        *number = column[lane];
    }
    out
}

/// Sets the numbers of one splat.
#[inline(always)]
pub(super) fn put<const N: usize>(columns: &mut Columns<N>, lane: usize, numbers: &[f32; N]) {
    for (column, number) in columns.iter_mut().zip(numbers) {
        column[lane] = *number;
    }
}

#[inline(always)]
pub(super) fn load2<L: Lanes>(columns: &[[f32; LANES]], i: usize) -> V2<L> {
    V2::new(L::load(&columns[i]), L::load(&columns[i + 1]))
}

#[inline(always)]
pub(super) fn load3<L: Lanes>(columns: &[[f32; LANES]], i: usize) -> V3<L> {
    V3::new(L::load(&columns[i]), L::load(&columns[i + 1]), L::load(&columns[i + 2]))
}

/// The triangles in nine columns.
#[inline(always)]
pub(super) fn triangles<L: Lanes>(columns: &Columns<9>) -> CameraTriangle<L> {
    CameraTriangle { first: load3(columns, 0), edges: [load3(columns, 3), load3(columns, 6)] }
}

/// The nine numbers of a triangle.
#[inline(always)]
pub(super) fn flat<R: Copy>(triangle: &CameraTriangle<R>) -> [R; 9] {
    let CameraTriangle { first: a, edges: [b, c] } = triangle;
    [a.x, a.y, a.z, b.x, b.y, b.z, c.x, c.y, c.z]
}

#[inline(always)]
pub(super) fn broadcast<L: Lanes>(v: V2<f32>) -> V2<L> {
    V2::new(L::splat(v.x), L::splat(v.y))
}

/// Unit direction from the camera to a triangle's centroid, and the distance.
#[inline]
pub(super) fn direction(camera: &KernelCamera, [v0, v1, v2]: &[Vec3; 3]) -> (V3<f32>, f32) {
    let offset = (*v0 - camera.position) + ((*v1 - *v0) + (*v2 - *v0)) * (1.0 / 3.0);
    let size = offset.abs().max_element();
    // The squares of much smaller or larger numbers leave the range of f32.
    let is_in_range = (1e-15..1e15).contains(&size);
    let length =
        if is_in_range || size == 0.0 { offset.length() } else { (offset / size).length() * size };
    let unit = if length > 0.0 { offset / length } else { Vec3::Z };
    (v3(unit), length)
}

/// Depth of a splat and its index.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct DepthKey {
    /// Bits of the depth, which is positive, so that they sort in its order.
    pub(crate) depth: u32,
    /// Index of the splat before the sort.
    pub(crate) index: u32,
}

const BITS: u32 = 11;
const BUCKETS: usize = 1 << BITS;

/// Sorts `keys` by depth; equal depths keep their order.
pub(crate) fn by_depth(keys: &mut Vec<DepthKey>, scratch: &mut Vec<DepthKey>) {
    scratch.clear();
    scratch.resize(keys.len(), DepthKey::default());
    for shift in [0, BITS, 2 * BITS] {
        let digit = |k: &DepthKey| (k.depth >> shift) as usize & (BUCKETS - 1);
        let mut starts = [0u32; BUCKETS];
        for key in keys.iter() {
            starts[digit(key)] += 1;
        }
        let mut sum = 0;
        for start in &mut starts {
            sum += std::mem::replace(start, sum);
        }
        for key in keys.iter() {
            let to = &mut starts[digit(key)];
            scratch[*to as usize] = *key;
            *to += 1;
        }
        std::mem::swap(keys, scratch);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sorts_as_a_stable_sort_does() {
        let rng = trisplat_scene::Rng::new(1, "sort", 0);
        let mut keys: Vec<DepthKey> = (0..5000)
            .map(|i| DepthKey {
                depth: ((rng.uniform(i) * 300.0).floor() * 0.1).to_bits(),
                index: i as u32,
            })
            .collect();
        let mut expected = keys.clone();
        expected.sort_by_key(|k| k.depth);
        by_depth(&mut keys, &mut Vec::new());
        assert_eq!(keys, expected);
    }
}
