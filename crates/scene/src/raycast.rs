//! Rays against an asset's faces.
//!
//! `obvhs` finds candidates in f32, in the scene moved to the unit cube; distances are f64 in the
//! scene's own units.

use crate::Rng;
use crate::mesh::Mesh;
use glam::{DVec3, Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use obvhs::ray::{Ray, RayHit};
use std::sync::OnceLock;

/// First intersection of a ray with an asset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// The face.
    pub face: u32,
    /// Distance from the ray's origin, units of the file.
    pub distance: f64,
}

/// The tree that [`Asset::raycast`](crate::Asset::raycast) builds at its first ray. A clone is
/// empty.
///
/// After a change of positions or indices in place, set it to its default: it is of the old
/// triangles.
#[derive(Default)]
pub struct RayTree(OnceLock<FaceTree>);

impl Clone for RayTree {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl std::fmt::Debug for RayTree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("RayTree").field("built", &self.0.get().is_some()).finish()
    }
}

impl RayTree {
    /// The first of the first `faces` faces of `mesh` on a ray; the tree is built at the
    /// first call, for its mesh.
    pub fn first_hit(
        &self,
        mesh: &Mesh,
        faces: usize,
        origin: Vec3,
        direction: Vec3,
    ) -> Option<Hit> {
        if !origin.is_finite() || !direction.is_finite() || direction == Vec3::ZERO {
            return None;
        }
        let origin = origin.as_dvec3();
        let direction = direction.as_dvec3();
        let length = direction.length();
        let mut nearest: Option<Hit> = None;
        let mut test = |face: u32| {
            // Along the direction as it was given: products of f32 are exact in f64, so rounding
            // gives no face without area a hit.
            let distance =
                intersect(origin, direction, mesh.corners(face as usize)).map(|t| t * length);
            if let Some(distance) = distance
                && nearest.is_none_or(|hit| {
                    distance < hit.distance || distance == hit.distance && face < hit.face
                })
            {
                nearest = Some(Hit { face, distance });
            }
            distance
        };
        let tree = self.0.get_or_init(|| FaceTree::new(mesh, faces));
        if tree.faces != faces || !tree.search(origin, direction / length, &mut test) {
            for face in 0..faces as u32 {
                test(face);
            }
        }
        nearest
    }
}

/// Distance, in lengths of `direction`, to a triangle seen from either side (Möller and Trumbore
/// 1997), edges included.
fn intersect(origin: DVec3, direction: DVec3, corners: [Vec3; 3]) -> Option<f64> {
    let [a, b, c] = corners.map(|v| v.as_dvec3());
    let ab = b - a;
    let ac = c - a;
    let from_a = origin - a;
    let normal = direction.cross(ac);
    let inverse = 1.0 / ab.dot(normal);
    let u = from_a.dot(normal) * inverse;
    let q = from_a.cross(ab);
    let v = direction.dot(q) * inverse;
    let t = ac.dot(q) * inverse;
    // Parallel rays have an infinite or NaN u, which fails here.
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && t >= 0.0 && t.is_finite()).then_some(t)
}

/// A tree over the finite faces of a scene, which it moves to the unit cube.
struct FaceTree {
    bvh: Bvh2,
    /// Number of faces when it was built.
    faces: usize,
    origin: DVec3,
    scale: f64,
}

/// Margin of the boxes in the unit cube, above the rounding of f32, so that no ray misses one.
const BOX_MARGIN: f32 = 4e-6;
/// Maximum distance of a ray's origin at which f64 still resolves [`BOX_MARGIN`], in unit cubes.
const MAX_DISTANCE: f64 = 1e6;

impl FaceTree {
    fn new(mesh: &Mesh, faces: usize) -> Self {
        let finite = |face: &u32| mesh.corners(*face as usize).iter().all(|v| v.is_finite());
        let indices: Vec<u32> = (0..faces as u32).filter(finite).collect();
        let boxes = indices.iter().map(|&face| {
            let [a, b, c] = mesh.corners(face as usize).map(Vec3A::from);
            Aabb::new(a.min(b).min(c), a.max(b).max(c))
        });
        let boxes: Vec<Aabb> = boxes.collect();
        let (boxes, origin, scale) = to_unit_cube(&boxes);
        let numbers = (0..boxes.len() as u32).collect();
        let mut bvh = PlocBuilder::new().build(
            PlocSearchDistance::Low,
            &boxes,
            numbers,
            SortPrecision::U64,
            0,
        );
        for i in &mut bvh.primitive_indices {
            *i = indices[*i as usize];
        }
        Self { bvh, faces, origin, scale }
    }

    /// Calls `test`, which returns the distance of a face, with every face that may be the nearest.
    /// False when the ray starts too far away to tell.
    fn search(
        &self,
        origin: DVec3,
        direction: DVec3,
        test: &mut impl FnMut(u32) -> Option<f64>,
    ) -> bool {
        let start = (origin - self.origin) * self.scale;
        let mut near = 0.0f64;
        let mut far = f64::INFINITY;
        for axis in 0..3 {
            let at = |plane: f64| (plane - start[axis]) / direction[axis];
            let low = at(-0.01);
            let high = at(1.01);
            if direction[axis] != 0.0 {
                near = near.max(low.min(high));
                far = far.min(low.max(high));
            } else if !(-0.01..=1.01).contains(&start[axis]) {
                return true;
            }
        }
        if near > MAX_DISTANCE || start.abs().max_element() > MAX_DISTANCE {
            return false;
        }
        if near > far {
            return true;
        }
        let ray = Ray::new_inf((start + near * direction).as_vec3a(), direction.as_vec3a());
        self.bvh.ray_traverse(ray, &mut RayHit::none(), |_, primitive| {
            let distance = test(self.bvh.primitive_indices[primitive]);
            // Behind the hit by more than rounding, so that ties are visited.
            distance
                .map_or(f32::INFINITY, |t| ((t * self.scale - near) as f32).max(0.0) + BOX_MARGIN)
        });
        true
    }
}

/// The boxes in a cube of side 1, each enlarged by [`BOX_MARGIN`] and a small amount that differs
/// from box to box; the origin and scale of the cube.
///
/// In the cube no area over- or underflows at any scale of the scene. The enlargement, a thousandth
/// of the box, breaks ties. Among equal boxes obvhs would join one pair per pass, in quadratic
/// time, into a tree as deep as the number of boxes.
fn to_unit_cube(boxes: &[Aabb]) -> (Vec<Aabb>, DVec3, f64) {
    let all = boxes.iter().fold(Aabb::empty(), |all, b| all.union(b));
    let origin = all.min.as_dvec3();
    let size = (all.max.as_dvec3() - all.min.as_dvec3()).max_element();
    let scale = if size > 0.0 { 1.0 / size } else { 1.0 };
    let place = |v: Vec3A| ((v.as_dvec3() - origin) * scale).as_vec3a();
    let rng = Rng::new(0, "bvh ties", 0);
    let grown = |(i, b): (usize, &Aabb)| {
        let min = place(b.min);
        let max = place(b.max);
        let bits = rng.bits(i as u64);
        let max_noise = 1e-3 * (max - min).max_element() + 1e-6;
        let by =
            |shift: u32| BOX_MARGIN + max_noise * (1.0 / 1024.0) * ((bits >> shift) & 0x3ff) as f32;
        Aabb::new(min - Vec3A::new(by(0), by(10), by(20)), max + Vec3A::new(by(30), by(40), by(50)))
    };
    (boxes.iter().enumerate().map(grown).collect(), origin, scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Equal boxes, where obvhs alone joins one pair a pass: seconds and a stack overflow without
    /// the tie-break.
    #[test]
    fn a_hundred_thousand_equal_triangles_build_a_shallow_tree() {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y].repeat(100_000);
        let tree = FaceTree::new(&Mesh { positions, ..Mesh::default() }, 100_000);
        assert!(tree.bvh.depth(0) < 64, "depth {}", tree.bvh.depth(0));
    }
}
