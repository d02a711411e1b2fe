//! The optimised parameters: unbounded raw numbers, and the physical soup that they describe.
//!
//! ```text
//! opacity = floor + (1 - floor) · sigmoid(gain · x)  floor 0 and gain 1, but for the solid anneal
//! sigma   = scale · (0.01 + exp(x))                 scale 1, but for the solid anneal
//! ```
//! (Held et al.'s code, `triangle_model.py`; the floor is that of TS+.)

use glam::Vec3;
use serde::{Deserialize, Serialize};
use trisplat_raster::kernel::window::mean_window;
use trisplat_scene::Soup;
use trisplat_scene::math::geometry::centroid;
use trisplat_scene::sh_count;

/// The lowest σ the activation gives before the anneal (`0.01 + exp(x)` in the paper's code).
pub(crate) const SIGMA_MIN: f32 = 0.01;

/// The σ of a solid triangle: no anneal goes below it.
pub(crate) const SIGMA_SOLID: f32 = 1e-4;

/// Raw parameters of N triangles, in training space.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Params {
    /// Corners. `[N, 3]`
    pub vertices: Vec<[Vec3; 3]>,
    /// Logit of the opacity. `[N]`
    pub opacity: Vec<f32>,
    /// Logarithm of σ - 0.01. `[N]`
    pub sigma: Vec<f32>,
    /// Spherical harmonics, degree 0 first. `[N * K]`
    pub sh: Vec<[f32; 3]>,
    /// Degree stored; K = (degree + 1)^2.
    pub sh_degree: u8,
}

/// The state of the solid anneal; [`Anneal::NONE`] for the soft scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Anneal {
    /// The least opacity, in [0, 1].
    pub opacity_floor: f32,
    /// Steepness of the sigmoid, at least 1: towards infinity triangles are either opaque or
    /// invisible.
    pub opacity_gain: f32,
    /// Factor of σ, in [0, 1].
    pub sigma_scale: f32,
}

impl Anneal {
    /// The soft scene.
    pub const NONE: Self = Self { opacity_floor: 0.0, opacity_gain: 1.0, sigma_scale: 1.0 };
    /// Every triangle opaque to its edges.
    pub const SOLID: Self = Self { opacity_floor: 1.0, opacity_gain: 1.0, sigma_scale: 0.0 };

    /// Opacity of a logit.
    pub fn opacity(&self, raw: f32) -> f32 {
        self.opacity_floor + (1.0 - self.opacity_floor) * sigmoid(self.opacity_gain * raw)
    }

    /// The logit of an opacity above the floor; `None` once the floor is 1.
    pub fn opacity_raw(&self, opacity: f32) -> Option<f32> {
        let free = 1.0 - self.opacity_floor;
        (free > 0.0).then(|| logit((opacity - self.opacity_floor) / free) / self.opacity_gain)
    }

    /// ∂loss/∂logit of ∂loss/∂opacity.
    pub fn opacity_grad(&self, raw: f32, d_opacity: f32) -> f32 {
        let s = sigmoid(self.opacity_gain * raw);
        d_opacity * (1.0 - self.opacity_floor) * self.opacity_gain * s * (1.0 - s)
    }

    /// σ of its raw value.
    pub fn sigma(&self, raw: f32) -> f32 {
        (self.sigma_scale * (SIGMA_MIN + raw.exp())).max(SIGMA_SOLID)
    }

    /// ∂loss/∂raw of ∂loss/∂σ.
    pub fn sigma_grad(&self, raw: f32, d_sigma: f32) -> f32 {
        d_sigma * self.sigma_scale * raw.exp()
    }
}

/// 1 / (1 + e^-x).
pub(crate) fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

/// The logit of an opacity, after clamping to [1e-6, 1 - 1e-6].
pub(crate) fn logit(opacity: f32) -> f32 {
    let o = opacity.clamp(1e-6, 1.0 - 1e-6);
    (o / (1.0 - o)).ln()
}

/// The raw value of a σ, after raising it above the lowest one.
pub(crate) fn sigma_raw(sigma: f32) -> f32 {
    (sigma - SIGMA_MIN).max(1e-6).ln()
}

/// Opacity of a frozen triangle's raw values. Drawn `flat`, without a window, it has the window's
/// mean as a factor.
pub(crate) fn frozen_opacity(opacity: f32, sigma: f32, flat: bool) -> f32 {
    let opacity = Anneal::NONE.opacity(opacity);
    if flat { opacity * mean_window(Anneal::NONE.sigma(sigma)) } else { opacity }
}

impl Params {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// True when there are none.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// Coefficients stored per triangle.
    pub fn sh_count(&self) -> usize {
        sh_count(self.sh_degree)
    }

    /// Raw parameters of a soup, its SH padded with zeros to `sh_degree`.
    pub fn from_soup(soup: &Soup, sh_degree: u8) -> Self {
        let from = soup.sh_count();
        let to = sh_count(sh_degree);
        let mut sh = vec![[0.0; 3]; soup.len() * to];
        for (i, row) in sh.chunks_exact_mut(to).enumerate() {
            let kept = from.min(to);
            row[..kept].copy_from_slice(&soup.sh[i * from..][..kept]);
        }
        Self {
            vertices: soup.vertices.clone(),
            opacity: soup.opacity.iter().map(|&o| logit(o)).collect(),
            sigma: soup.sigma.iter().map(|&s| sigma_raw(s)).collect(),
            sh,
            sh_degree,
        }
    }

    /// Converts the soft triangles after the first `skipped` to the state of `anneal`, with the
    /// same look.
    pub(super) fn anneal_soft(&mut self, anneal: &Anneal, skipped: usize) {
        for opacity in self.opacity.iter_mut().skip(skipped) {
            *opacity = anneal.opacity_raw(Anneal::NONE.opacity(*opacity)).unwrap_or(*opacity);
        }
        for sigma in self.sigma.iter_mut().skip(skipped).filter(|_| anneal.sigma_scale > 0.0) {
            *sigma = sigma_raw(Anneal::NONE.sigma(*sigma) / anneal.sigma_scale);
        }
    }

    /// The soup of these parameters, with the first `active_degree` degrees of SH.
    pub fn to_soup(&self, anneal: &Anneal, active_degree: u8) -> Soup {
        let mut soup = Soup {
            vertices: self.vertices.clone(),
            opacity: self.opacity.iter().map(|&x| anneal.opacity(x).min(1.0)).collect(),
            sigma: self.sigma.iter().map(|&x| anneal.sigma(x)).collect(),
            sh: self.sh.clone(),
            sh_degree: self.sh_degree,
            ..Soup::default()
        };
        soup.truncate_sh(active_degree);
        soup
    }

    /// Appends triangle `i` of `from`; both have the same SH degree.
    pub fn push(&mut self, from: &Params, i: usize) {
        let k = from.sh_count();
        self.vertices.push(from.vertices[i]);
        self.opacity.push(from.opacity[i]);
        self.sigma.push(from.sigma[i]);
        self.sh.extend_from_slice(&from.sh[i * k..][..k]);
    }

    /// True when every number of triangle `i` is finite.
    pub fn is_finite(&self, i: usize) -> bool {
        let k = self.sh_count();
        self.vertices[i].iter().all(|v| v.is_finite())
            && self.opacity[i].is_finite()
            && self.sigma[i].is_finite()
            && self.sh[i * k..][..k].as_flattened().iter().all(|x| x.is_finite())
    }
}

/// Parameters with Adam's moments: the whole state of the optimiser.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct OptimizerState {
    /// The parameters.
    pub params: Params,
    /// First moments, shaped like the parameters.
    pub first: Params,
    /// Second moments, shaped like the parameters.
    pub second: Params,
    /// The first `pinned` triangles only change their colour, which is the same from all sides.
    /// They are neither pruned nor grown.
    pub pinned: usize,
    /// The first `frozen` triangles are not trained: the rest of a scene when only a part is
    /// trained.
    pub frozen: usize,
}

impl OptimizerState {
    /// Fresh moments for `params`.
    pub fn new(params: Params) -> Self {
        let zero = Params {
            vertices: vec![[Vec3::ZERO; 3]; params.len()],
            opacity: vec![0.0; params.len()],
            sigma: vec![0.0; params.len()],
            sh: vec![[0.0; 3]; params.sh.len()],
            sh_degree: params.sh_degree,
        };
        Self { first: zero.clone(), second: zero, params, pinned: 0, frozen: 0 }
    }

    /// Appends triangle `i` of `from` with its moments.
    pub fn push(&mut self, from: &OptimizerState, i: usize) {
        self.params.push(&from.params, i);
        self.first.push(&from.first, i);
        self.second.push(&from.second, i);
    }

    /// Appends `params`' triangle `i` with moments of zero.
    pub fn push_fresh(&mut self, params: &Params, i: usize) {
        self.params.push(params, i);
        for moment in [&mut self.first, &mut self.second] {
            moment.vertices.push([Vec3::ZERO; 3]);
            moment.opacity.push(0.0);
            moment.sigma.push(0.0);
            moment.sh.resize(moment.sh.len() + params.sh_count(), [0.0; 3]);
        }
    }

    /// An empty state for the same SH degree.
    pub fn empty_like(&self) -> Self {
        let empty = Params { sh_degree: self.params.sh_degree, ..Params::default() };
        let pinned = self.pinned;
        let frozen = self.frozen;
        Self { params: empty.clone(), first: empty.clone(), second: empty, pinned, frozen }
    }
}

/// is full.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Core {
    /// Lowest coordinates, inclusive; `None`: unbounded.
    pub low: [Option<f32>; 3],
    /// Highest coordinates, exclusive; `None`: unbounded.
    pub high: [Option<f32>; 3],
    /// Maximum number of triangles with their middle in the box.
    pub triangles: u64,
}

impl Core {
    /// True if triangle `i` has its middle in the box.
    pub(super) fn holds(&self, params: &Params, i: usize) -> bool {
        let middle = centroid(params.vertices[i]);
        (0..3).all(|k| {
            self.low[k].is_none_or(|low| middle[k] >= low)
                && self.high[k].is_none_or(|high| middle[k] < high)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn activations_invert() {
        let a = Anneal::NONE;
        for o in [0.001f32, 0.28, 0.5, 0.99] {
            assert!((a.opacity(logit(o)) - o).abs() < 1e-6);
        }
        for s in [0.02f32, 1.16, 40.0] {
            assert!((a.sigma(sigma_raw(s)) / s - 1.0).abs() < 1e-5);
        }
        assert!(logit(0.0).is_finite() && logit(1.0).is_finite() && sigma_raw(0.0).is_finite());
    }

    #[test]
    fn chain_rules_are_the_derivatives() {
        let a = Anneal { opacity_floor: 0.3, opacity_gain: 1.7, sigma_scale: 0.5 };
        for x in [-2.0f32, -0.3, 0.0, 1.5] {
            let h = 1e-2;
            let opacity = (a.opacity(x + h) - a.opacity(x - h)) / (2.0 * h);
            // h² / 6 times the third derivative, which is at most gain³ / 8.
            assert!((a.opacity_grad(x, 1.0) - opacity).abs() < 2e-5);
            let sigma = (a.sigma(x + h) - a.sigma(x - h)) / (2.0 * h);
            assert!((a.sigma_grad(x, 1.0) / sigma - 1.0).abs() < 1e-4);
        }
    }
}
