//! The window function (Held et al. 2025, eq. 1), the alpha it gives, and the blending of alphas
//! front to back.
//!
//! ```text
//! I(p) = ReLU(φ(p) / φ(s))^σ,   alpha(p) = min(cap, o · I(p)),   drawn where o · I(p) >= cutoff
//! ```
//!
//! Also the window of an engine: the covered part of each pixel.

use std::f64::consts::LN_2;
use trisplat_scene::math::real::{Mask, Real, V2};

/// Smallest window ratio that is drawn. A solid triangle (σ towards 0) loses a rim of this fraction
/// of its inradius; in exchange no logarithm or quotient of a ratio can overflow.
pub(super) const RATIO_FLOOR: f64 = 1.0 / 1_048_576.0;

/// Three ratios, the smallest being φ(p) / φ(s); `offset` is p - origin.
#[inline(always)]
pub fn ratios<R: Real>(edge: &[V2<R>; 3], shift: R, offset: V2<R>) -> [R; 3] {
    [edge[0].dot(offset), edge[1].dot(offset) - shift, edge[2].dot(offset)]
}

/// φ(p) / φ(s): 1 at the incenter, 0 on the boundary, negative outside.
#[inline(always)]
pub fn ratio<R: Real>(ratios: &[R; 3]) -> R {
    ratios[0].min(ratios[1]).min(ratios[2])
}

/// Flags the nearest edge: exactly one of three, the first in a tie.
#[inline(always)]
pub fn nearest<R: Real>(ratios: &[R; 3]) -> [R::Mask; 3] {
    let first = ratios[0].le(ratios[1]).and(ratios[0].le(ratios[2]));
    let second = ratios[1].le(ratios[2]).and(first.not());
    [first, second, first.or(second).not()]
}

/// The smallest ratio that is drawn: where o · I falls to `cutoff`, never below `RATIO_FLOOR`.
///
/// The region {ratio >= floor} is the triangle shrunk about its incenter by 1 - floor.
#[inline(always)]
pub fn ratio_floor<R: Real>(log2_opacity: R, sigma: R, log2_cutoff: R) -> R {
    ((log2_cutoff - log2_opacity) / sigma).max(R::of(-30.0)).exp2().max(R::of(RATIO_FLOOR))
}

/// Alpha before the cap, o · ratio^σ. Domain: ratio >= `RATIO_FLOOR`.
///
/// On a needle, rounding may raise the ratio above 1, and a large σ then leaves the domain of exp2.
/// Alpha never exceeds 1, so clamping the exponent there changes nothing.
#[inline(always)]
pub fn alpha<R: Real>(log2_ratio: R, log2_opacity: R, sigma: R) -> R {
    sigma.mul_add(log2_ratio, log2_opacity).min(R::of(1.0)).exp2()
}

/// The mean of I over the triangle: the distance φ from the nearest edge has the density 2 (1 - φ),
/// so the integral of φ^σ is 2 / ((σ + 1) (σ + 2)).
pub fn mean_window(sigma: f32) -> f32 {
    2.0 / ((sigma + 1.0) * (sigma + 2.0))
}

/// ∂L/∂σ and ∂L/∂ratio for `d_log` = ∂L/∂alpha · alpha (which is also ∂L/∂o · o). `min_ratio`
/// bounds the quotient: at a small σ the slope at the boundary is unbounded.
#[inline(always)]
pub fn alpha_grad<R: Real>(ratio: R, log2_ratio: R, sigma: R, min_ratio: R, d_log: R) -> (R, R) {
    (d_log * log2_ratio * R::of(LN_2), d_log * sigma / ratio.max(min_ratio))
}

/// The part of a pixel that a triangle covers; `distances` are those of its centre to the three
/// edges, in widths of the pixel, positive inside. Below 0 far outside, 1 well inside.
///
/// ```text
/// c = 1 - Σ_i max(0, 1/2 - d_i)
/// ```
/// Exact for a box filter across an edge parallel to an axis and for strips of any width. In pixels
/// with a corner it is a lower bound, so thin triangles do not extend beyond their tips.
#[inline(always)]
pub fn coverage<R: Real>(distances: &[R; 3]) -> R {
    let outside = |d: R| (R::of(0.5) - d).max(R::of(0.0));
    R::of(1.0) - outside(distances[0]) - outside(distances[1]) - outside(distances[2])
}

/// Flags the edges that cut the pixel: ∂c/∂d_i is 1 for these and 0 for the others. Domain: c > 0.
#[inline(always)]
pub fn coverage_edges<R: Real>(distances: &[R; 3]) -> [R::Mask; 3] {
    distances.map(|d| d.lt(R::of(0.5)))
}

// ---- Front-to-back blending ---------------------------------------------------------------------

/// Weight of a layer and the transmittance behind it.
#[inline(always)]
pub fn blend<R: Real>(transmittance: R, alpha: R) -> (R, R) {
    (transmittance * alpha, transmittance * (R::of(1.0) - alpha))
}

/// ∂L/∂alpha of a layer, with `value` = ∂L/∂w of the layer, `behind` = Σ w ∂L/∂w of all that lies
/// behind it.
///
/// ```text
/// ∂L/∂alpha_k = T_k value_k - behind_k / (1 - alpha_k)
/// ```
/// Behind the layer that ends a pixel there is only the background, seen through T_k (1 - alpha_k);
/// there `behind / (1 - alpha)` is T_k · background exactly, even at alpha = 1.
#[inline(always)]
pub fn blend_grad<R: Real>(
    transmittance: R,
    alpha: R,
    value: R,
    behind: R,
    last: R::Mask,
    background: R,
) -> R {
    let through = R::select(last, transmittance * background, behind / (R::of(1.0) - alpha));
    transmittance.mul_add(value, -through)
}

/// True for a layer that takes the transmittance from 1/2 or more to less: it has the median depth.
#[inline(always)]
pub(crate) fn is_median<R: Real>(before: R, after: R) -> R::Mask {
    let half = R::of(0.5);
    half.le(before).and(after.lt(half))
}

/// Pairwise depth distortion (Huang et al. 2024, 2DGS, eq. 13), Σ_{j<k} w_j w_k (m_j - m_k)²,
/// extended by a layer: what the layer adds, given Σ w, Σ w m and Σ w m² of the layers in front.
#[inline(always)]
pub fn distortion<R: Real>(weight: R, m: R, sums: [R; 3]) -> R {
    weight * pair_cost(m, sums)
}

/// ∂distortion/∂w and ∂distortion/∂m of a layer, given Σ w, Σ w m and Σ w m² of *all* layers.
#[inline(always)]
pub fn distortion_grad<R: Real>(weight: R, m: R, sums: [R; 3]) -> (R, R) {
    (pair_cost(m, sums), (weight + weight) * (m * sums[0] - sums[1]))
}

/// Σ w_j (m - m_j)².
#[inline(always)]
fn pair_cost<R: Real>(m: R, [w, wm, wmm]: [R; 3]) -> R {
    m * (m * w - wm - wm) + wmm
}
