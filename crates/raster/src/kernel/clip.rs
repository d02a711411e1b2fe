//! Clips a triangle at the near plane, as an engine does: the part in front is one or two triangles.
//!
//! ```text
//! all in front       one behind               two behind
//!                        0 (behind)                1
//!      0              ··a···b··  near           ··a···b·· near
//!     / \              /   / \                 2 ·······  0 (in front: only the tip is kept)
//!    1---2            1---/---2
//!                     (1, 2, b)  (1, b, a)     (0, a, b)
//! ```

use trisplat_scene::math::real::Real;
use trisplat_scene::math::real::V3;

/// A corner of a piece: the point between two corners of the triangle, or the corner itself when both are the same.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PieceCorner {
    /// The corner in front of the plane.
    pub from: u8,
    /// The corner behind it, or `from`.
    pub to: u8,
}

/// A piece of a triangle, corners in the triangle's own winding; the first is always a corner of the triangle.
pub type Piece = [PieceCorner; 3];

const fn corner(from: u8, to: u8) -> PieceCorner {
    PieceCorner { from, to }
}

/// The whole triangle.
pub const WHOLE: Piece = [corner(0, 0), corner(1, 1), corner(2, 2)];

/// The pieces in front of the plane: none, one or two. `front[i]` says whether corner i is in front of it.
pub fn pieces(front: [bool; 3]) -> ([Piece; 2], usize) {
    // PieceCorner i is alone on its side, j and k follow it.
    let from = |i: u8| (i, (i + 1) % 3, (i + 2) % 3);
    let tip = |(i, j, k): (u8, u8, u8)| ([[corner(i, i), corner(i, j), corner(i, k)], WHOLE], 1);
    let stump = |(i, j, k): (u8, u8, u8)| {
        let (near_j, near_k) = (corner(j, i), corner(k, i));
        ([[corner(j, j), corner(k, k), near_k], [corner(j, j), near_k, near_j]], 2)
    };
    match front {
        [true, true, true] => ([WHOLE, WHOLE], 1),
        [false, false, false] => ([WHOLE, WHOLE], 0),
        [true, false, false] => tip(from(0)),
        [false, true, false] => tip(from(1)),
        [false, false, true] => tip(from(2)),
        [false, true, true] => stump(from(0)),
        [true, false, true] => stump(from(1)),
        [true, true, false] => stump(from(2)),
    }
}

/// The point between `from` (in front) and `to` (behind) whose depth is `near`.
#[inline(always)]
pub fn near_point<R: Real>(from: V3<R>, to: V3<R>, near: R) -> V3<R> {
    let t = (near - from.z) / (to.z - from.z);
    let edge = to - from;
    V3 { x: edge.x.mul_add(t, from.x), y: edge.y.mul_add(t, from.y), z: near }
}

/// Gradients of `from` and `to` for a gradient `d` of [`near_point`].
#[inline(always)]
pub fn near_point_grad<R: Real>(from: V3<R>, to: V3<R>, near: R, d: V3<R>) -> (V3<R>, V3<R>) {
    let edge = to - from;
    let t = (near - from.z) / edge.z;
    let rest = R::of(1.0) - t;
    let d_t = d.x.mul_add(edge.x, d.y * edge.y) / edge.z;
    let zero = R::of(0.0);
    let flat = V3::new(d.x, d.y, zero);
    (flat.scale(rest) - V3::new(zero, zero, d_t * rest), flat.scale(t) - V3::new(zero, zero, d_t * t))
}
