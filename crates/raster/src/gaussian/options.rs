//! How Gaussians are drawn, with the constants of the published renderer.

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

impl Default for GaussianOptions {
    fn default() -> Self {
        Self { background: [0.0; 3], near: 0.05 }
    }
}
