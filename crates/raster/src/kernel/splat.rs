//! A triangle seen by one camera (Held et al. 2025, section 3), and its pieces in front of the near
//! plane.

use trisplat_scene::math::real::{Mask, Real, V2, V3};

/// A triangle in camera space as a corner and two differences, so that a small far triangle keeps
/// its precision.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraTriangle<R> {
    /// v0.
    pub first: V3<R>,
    /// v1 - v0 and v2 - v0.
    pub edges: [V3<R>; 2],
}

/// A triangle on the screen; all other points are relative to `origin`.
///
/// ```text
/// ratio(p) = φ(p) / φ(s) = min_i (edge_i · (p - origin) - shift_i),  shift_0 = shift_2 = 0
/// 1 / z(p) = inv_depth + slope · (p - origin)
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Splat<R> {
    /// q0, px.
    pub origin: V2<R>,
    /// q1 - q0 and q2 - q0, px.
    pub sides: [V2<R>; 2],
    /// Inward unit normals of q0q1, q1q2, q2q0 over the inradius, 1/px.
    pub edge: [V2<R>; 3],
    /// edge_1 · (q1 - q0).
    pub shift: R,
    /// -φ(s), px; 0 or NaN when degenerate.
    pub inradius: R,
}

/// Depth plane and normal of a [`Splat`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthPlane<R> {
    /// 1 / z at the origin.
    pub inv_depth: R,
    /// Gradient of 1 / z, 1/px.
    pub slope: V2<R>,
    /// Unit normal in camera space, towards the camera.
    pub normal: V3<R>,
}

/// ∂L of a [`Splat`], summed over pixels: the gradient d of ratio_i, and d · (p - origin).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SplatGrad<R> {
    /// Sum of ∂L/∂ratio over the pixels whose nearest edge is i.
    pub ratio: [R; 3],
    /// Sum of ∂L/∂ratio · (p - origin) over them.
    pub moment: [V2<R>; 3],
    /// ∂L/∂inradius through the fade of tiny triangles.
    pub inradius: R,
    /// 1: ratios change with φ(s); 0: φ(s) is constant, as in distances, from which it cancels.
    pub by_incenter: R,
}

/// ∂L of a [`DepthPlane`] as seen from pixels; `inv_depth` sums ∂L/∂(1/z), `slope` sums it times (p
/// - origin).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DepthPlaneGrad<R> {
    /// Sum of ∂L/∂(1/z).
    pub inv_depth: R,
    /// Sum of ∂L/∂(1/z) · (p - origin).
    pub slope: V2<R>,
    /// Sum of ∂L/∂normal.
    pub normal: V3<R>,
}

/// A screen difference: q_k - q_0 = f (e_k.xy - u e_k.z) / z_k with `u` = v0.xy / v0.z.
#[inline(always)]
fn side<R: Real>(u: V2<R>, first_z: R, e: V3<R>, focal: V2<R>) -> V2<R> {
    (e.xy() - u.scale(e.z)).mul_components(focal).scale(R::of(1.0) / (first_z + e.z))
}

/// The edges of a triangle with two sides `a` and `b`, their lengths and sum, and a × b.
#[inline(always)]
fn outline<R: Real>([a, b]: [V2<R>; 2]) -> ([V2<R>; 3], [R; 3], R, R) {
    let outline = [a, b - a, -b];
    let lengths = [outline[0].length(), outline[1].length(), outline[2].length()];
    (outline, lengths, lengths[0] + lengths[1] + lengths[2], a.cross(b))
}

/// The splat of a triangle wholly in front of the camera. Degenerate triangles give inradius 0 or
/// NaN and edges that must not be used.
#[inline(always)]
pub fn splat<R: Real>(corners: &CameraTriangle<R>, focal: V2<R>, center: V2<R>) -> Splat<R> {
    let CameraTriangle { first, edges } = *corners;
    let u = first.xy().scale(R::of(1.0) / first.z);
    let a = side(u, first.z, edges[0], focal);
    let b = side(u, first.z, edges[1], focal);
    let (outline, lengths, perimeter, cross) = outline([a, b]);
    let scale = perimeter / cross;
    let mut edge = [V2::zero(); 3];
    for i in 0..3 {
        edge[i] = outline[i].perp().scale(scale / lengths[i]);
    }
    Splat {
        origin: u.mul_components(focal) + center,
        sides: [a, b],
        edge,
        shift: edge[1].dot(a),
        inradius: cross.abs() / perimeter,
    }
}

/// Gradient of the corners for the gradient `d` of their [`splat`].
///
/// ```text
/// edge_i = c_i perp(w_i),  c_i = P / (cross l_i),  w = (a, b - a, -b),  l_i = |w_i|,  P = Σ l_i
/// ```
#[inline(always)]
pub fn splat_grad<R: Real>(
    corners: &CameraTriangle<R>,
    focal: V2<R>,
    splat: &Splat<R>,
    d: &SplatGrad<R>,
) -> CameraTriangle<R> {
    let [a, b] = splat.sides;
    let (outline, lengths, perimeter, cross) = outline([a, b]);
    let mut d_edge = d.moment;
    let d_shift = -d.ratio[1];
    d_edge[1] = d_edge[1] + a.scale(d_shift);
    let mut d_perimeter = R::of(0.0);
    let mut d_cross = R::of(0.0);
    let mut d_lengths = [R::of(0.0); 3];
    let mut d_outline = [V2::zero(); 3];
    for i in 0..3 {
        let along = d_edge[i].dot(splat.edge[i]);
        let c = perimeter / (cross * lengths[i]);
        d_outline[i] = -d_edge[i].perp().scale(c);
        d_lengths[i] = -along / lengths[i];
        d_perimeter = d_perimeter + along / perimeter;
        d_cross = d_cross - along / cross;
    }
    let sign = cross.abs() / cross;
    d_perimeter = (d_perimeter - d.inradius * splat.inradius / perimeter) * d.by_incenter;
    d_cross = (d_cross + d.inradius * sign / perimeter) * d.by_incenter;
    for i in 0..3 {
        d_outline[i] = d_outline[i] + outline[i].scale((d_lengths[i] + d_perimeter) / lengths[i]);
    }
    let d_a = d_outline[0] - d_outline[1] - b.perp().scale(d_cross) + splat.edge[1].scale(d_shift);
    let d_b = d_outline[1] - d_outline[2] + a.perp().scale(d_cross);
    let d_origin = -(splat.edge[0].scale(d.ratio[0])
        + splat.edge[1].scale(d.ratio[1])
        + splat.edge[2].scale(d.ratio[2]));
    screen_grad(corners, focal, splat, d_origin, [d_a, d_b])
}

/// Gradient of the corners for gradients of the origin and the two sides on the screen.
#[inline(always)]
fn screen_grad<R: Real>(
    corners: &CameraTriangle<R>,
    focal: V2<R>,
    splat: &Splat<R>,
    d_origin: V2<R>,
    d_sides: [V2<R>; 2],
) -> CameraTriangle<R> {
    let CameraTriangle { first, edges } = *corners;
    let inv_z = R::of(1.0) / first.z;
    let u = first.xy().scale(inv_z);
    let mut d_u = d_origin.mul_components(focal);
    let mut d_first_z = R::of(0.0);
    let mut d_edges = [V3::zero(); 2];
    for k in 0..2 {
        let inv_k = R::of(1.0) / (first.z + edges[k].z);
        let g = d_sides[k].mul_components(focal).scale(inv_k);
        d_u = d_u - g.scale(edges[k].z);
        let d_z = -(d_sides[k].dot(splat.sides[k])) * inv_k;
        d_first_z = d_first_z + d_z;
        d_edges[k] = V3::new(g.x, g.y, d_z - g.dot(u));
    }
    let d_xy = d_u.scale(inv_z);
    CameraTriangle {
        first: V3::new(d_xy.x, d_xy.y, d_first_z - d_u.dot(u) * inv_z),
        edges: d_edges,
    }
}

/// Depth plane and normal of a triangle wholly in front of the camera.
///
/// ```text
/// n = e1 × e2,  1 / z(p) = n · K⁻¹(p, 1) / (n · v0)
/// ```
#[inline(always)]
pub fn depth_plane<R: Real>(corners: &CameraTriangle<R>, focal: V2<R>) -> DepthPlane<R> {
    let (n, _) = scaled_normal(corners);
    let offset = n.dot(corners.first);
    let inv_offset = R::of(1.0) / offset;
    let slope = V2::new(n.x / focal.x, n.y / focal.y).scale(inv_offset);
    let inv_length = R::of(1.0) / n.length();
    DepthPlane {
        inv_depth: R::of(1.0) / corners.first.z,
        slope,
        normal: n.scale(towards_camera(offset, inv_length)),
    }
}

/// The unnormalised normal of the edges scaled to size one, and that scale, so that no square can
/// overflow.
#[inline(always)]
fn scaled_normal<R: Real>(corners: &CameraTriangle<R>) -> (V3<R>, R) {
    let [e1, e2] = corners.edges;
    let scale = R::of(1.0) / e1.max_abs().max(e2.max_abs());
    (e1.scale(scale).cross(e2.scale(scale)), scale)
}

#[inline(always)]
fn towards_camera<R: Real>(offset: R, inv_length: R) -> R {
    R::select(offset.lt(R::of(0.0)), inv_length, -inv_length)
}

/// Gradient of the corners for the gradient `d` of their [`depth_plane`] and of the origin it is
/// measured from.
#[inline(always)]
pub fn depth_plane_grad<R: Real>(
    corners: &CameraTriangle<R>,
    focal: V2<R>,
    splat: &Splat<R>,
    plane: &DepthPlane<R>,
    d: &DepthPlaneGrad<R>,
) -> CameraTriangle<R> {
    let (n, scale) = scaled_normal(corners);
    let e1 = corners.edges[0].scale(scale);
    let e2 = corners.edges[1].scale(scale);
    let inv_offset = R::of(1.0) / n.dot(corners.first);
    let inv_length = R::of(1.0) / n.length();
    let signed = towards_camera(n.dot(corners.first), inv_length);
    let mut d_n = (d.normal - plane.normal.scale(plane.normal.dot(d.normal))).scale(signed);
    d_n.x = d_n.x + d.slope.x / focal.x * inv_offset;
    d_n.y = d_n.y + d.slope.y / focal.y * inv_offset;
    let d_offset = -d.slope.dot(plane.slope) * inv_offset;
    d_n = d_n + corners.first.scale(d_offset);
    let mut d_first = n.scale(d_offset);
    d_first.z = d_first.z - d.inv_depth * plane.inv_depth * plane.inv_depth;
    let moved = screen_grad(
        corners,
        focal,
        splat,
        -plane.slope.scale(d.inv_depth),
        [V2::zero(), V2::zero()],
    );
    let d_n = d_n.scale(scale);
    CameraTriangle { first: d_first + moved.first, edges: [e2.cross(d_n), d_n.cross(e1)] }
}

/// Opacity factor of tiny triangles: 0 at inradius 0, 1 from `full_px` on, smooth between; 1 for
/// `full_px` = 0.
///
/// ```text
/// x = clamp(inradius / full_px, 0, 1),  fade = x² (3 - 2x)
/// ```
#[inline(always)]
pub fn fade<R: Real>(inradius: R, full_px: R) -> R {
    let x = fade_position(inradius, full_px);
    x * x * (R::of(3.0) - x - x)
}

/// ∂fade/∂inradius.
#[inline(always)]
pub fn fade_grad<R: Real>(inradius: R, full_px: R) -> R {
    let x = fade_position(inradius, full_px);
    let slope = R::of(6.0) * x * (R::of(1.0) - x) / full_px;
    let inside = R::of(0.0).lt(full_px).and(inradius.lt(full_px));
    R::select(inside, slope, R::of(0.0))
}

#[inline(always)]
fn fade_position<R: Real>(inradius: R, full_px: R) -> R {
    let one = R::of(1.0);
    R::select(inradius.lt(full_px), inradius / full_px, one).max(R::of(0.0))
}

/// The incenter minus the origin: where all three ratios are 1.
#[inline(always)]
pub fn incenter<R: Real>(splat: &Splat<R>) -> V2<R> {
    let [a, b] = splat.sides;
    let l0 = a.length();
    let l1 = (b - a).length();
    let l2 = b.length();
    (a.scale(l2) + b.scale(l0)).scale(R::of(1.0) / (l0 + l1 + l2))
}

// ---- Clips a triangle at the near plane, as an engine does: the part in front is one or two triangles

/// A corner of a piece: the point between two corners of the triangle, or the corner itself when
/// both are the same.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PieceCorner {
    /// The corner in front of the plane.
    pub from: u8,
    /// The corner behind it, or `from`.
    pub to: u8,
}

/// A piece of a triangle, corners in the triangle's own winding; the first is always a corner of
/// the triangle.
pub type Piece = [PieceCorner; 3];

const fn corner(from: u8, to: u8) -> PieceCorner {
    PieceCorner { from, to }
}

/// The whole triangle.
pub const WHOLE: Piece = [corner(0, 0), corner(1, 1), corner(2, 2)];

/// The pieces in front of the plane: none, one or two. `front[i]` says whether corner i is in front
/// of it.
pub fn pieces(front: [bool; 3]) -> ([Piece; 2], usize) {
    // PieceCorner i is alone on its side, j and k follow it.
    let from = |i: u8| (i, (i + 1) % 3, (i + 2) % 3);
    let tip = |(i, j, k): (u8, u8, u8)| ([[corner(i, i), corner(i, j), corner(i, k)], WHOLE], 1);
    let stump = |(i, j, k): (u8, u8, u8)| {
        let near_j = corner(j, i);
        let near_k = corner(k, i);
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
    (
        flat.scale(rest) - V3::new(zero, zero, d_t * rest),
        flat.scale(t) - V3::new(zero, zero, d_t * t),
    )
}
