//! Front-to-back blending.
//!
//! ```text
//! w_k = T_k alpha_k,   T_{k+1} = T_k (1 - alpha_k),   C = Σ w_k c_k + T background
//! ```

use trisplat_scene::math::real::{Mask, Real};

/// Weight of a layer and the transmittance behind it.
#[inline(always)]
pub fn blend<R: Real>(transmittance: R, alpha: R) -> (R, R) {
    (transmittance * alpha, transmittance * (R::of(1.0) - alpha))
}

/// ∂L/∂alpha of a layer, with `value` = ∂L/∂w of the layer, `behind` = Σ w ∂L/∂w of all that lies behind it.
///
/// ```text
/// ∂L/∂alpha_k = T_k value_k - behind_k / (1 - alpha_k)
/// ```
/// Behind the layer that ends a pixel there is only the background, seen through T_k (1 - alpha_k); there
/// `behind / (1 - alpha)` is T_k · background exactly, even at alpha = 1.
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

/// Whether a layer takes the transmittance from 1/2 or more to less: it holds the median depth.
#[inline(always)]
pub(crate) fn is_median<R: Real>(before: R, after: R) -> R::Mask {
    let half = R::of(0.5);
    half.le(before).and(after.lt(half))
}

/// Pairwise depth distortion (Huang et al. 2024, 2DGS, eq. 13), Σ_{j<k} w_j w_k (m_j - m_k)², extended by a layer:
/// what the layer adds, given Σ w, Σ w m and Σ w m² of the layers in front.
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
