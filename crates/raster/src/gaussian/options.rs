//! How Gaussians are drawn, with the constants of the published renderer.

use glam::DVec3;
use trisplat_scene::Splats;

/// Largest alpha of a layer.
pub(super) const ALPHA_CAP: f32 = 0.99;
/// Logarithm to base 2 of the smallest alpha that is drawn, 1/255.
pub(super) const LOG2_CUTOFF: f32 = -7.994_353_4;
/// A pixel ends with the layer that brings its transmittance below this.
pub(super) const MIN_TRANSMITTANCE: f32 = 1e-4;
/// The Jacobian of the projection is taken no farther from the axis than this many times half the view.
pub(super) const VIEW_GUARD: f32 = 1.3;

/// How to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussianOptions {
    /// Colour behind everything, sRGB-encoded.
    pub background: [f32; 3],
    /// Depth from which on the middles of Gaussians are drawn, world units, > 0.
    pub near: f32,
}

/// Depth of the near plane in units of the scene's size, for scenes so small that the usual depth would cut into them.
const NEAR_PER_SIZE: f64 = 0.01;

impl GaussianOptions {
    /// For `splats` of any size, over a background, sRGB-encoded.
    pub fn suited_to(splats: &Splats, background: [f32; 3]) -> Self {
        let usual = Self::default().near;
        let near = usual.min((size_of(splats) * NEAR_PER_SIZE) as f32).max(f32::MIN_POSITIVE);
        Self { background, near }
    }
}

/// Mean distance of the Gaussians from their middle.
fn size_of(splats: &Splats) -> f64 {
    let count = splats.len().max(1) as f64;
    let middle = splats.positions.iter().map(|p| p.as_dvec3()).sum::<DVec3>() / count;
    splats.positions.iter().map(|p| p.as_dvec3().distance(middle)).sum::<f64>() / count
}

impl Default for GaussianOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], near: 0.05 }
    }
}
