//! How the soft rasteriser draws.

use crate::math::color::linear_from_srgb;
use crate::math::real::Real;

/// In which order the layers of a pixel are blended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sort {
    /// By the depth of the triangles' centroids, the same for all pixels; ties by index.
    #[default]
    Tile,
    /// By the depth of the triangles' planes at each pixel; ties by the order of `Tile`.
    Pixel,
}

/// How a triangle ends at its edges.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Window {
    /// Held et al. 2025, eq. 1.
    #[default]
    Soft,
    /// The part of each pixel it covers: the antialiased picture of an engine; σ and the fade do not matter.
    Coverage {
        /// Width of the ramp across an edge, px; 1 is a pixel's own filter.
        width_px: f32,
    },
    /// A sigmoid of the distance from the edges in units of σ px, not bounded by them; the window of earlier work
    /// that the paper's ablation compares with. The fade does not matter.
    Sigmoid,
}

impl Window {
    /// An inradius, px, in the unit of this window's distances from edges.
    #[inline(always)]
    pub(super) fn scale<R: Real>(self, inradius: R) -> R {
        match self {
            Window::Soft => R::of(1.0),
            Window::Coverage { width_px } => inradius / R::of(width_px.into()),
            Window::Sigmoid => inradius,
        }
    }
}

/// How to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoftOptions {
    /// How triangles end at their edges.
    pub window: Window,
    /// Colour behind everything, sRGB-encoded.
    pub background: [f32; 3],
    /// Blend in linear light, as engines do: colours are decoded before, and the frame is left linear.
    pub linear: bool,
    /// Blending order.
    pub sort: Sort,
    /// Largest alpha of a layer, in (0, 1]; 0.99 in the reference code, 1 for solid triangles.
    pub alpha_cap: f32,
    /// Smallest o · I that is drawn: the one cutoff, of bounds and of pixels.
    pub cutoff: f32,
    /// A pixel terminates with the layer that brings its transmittance below this.
    pub min_transmittance: f32,
    /// Whether gradients pass through φ(s) and the fade; false holds the inradius constant as the reference code does.
    pub exact_incenter: bool,
    /// Depth of the near plane at which triangles are clipped, world units, > 0.
    pub near: f32,
    /// Inradius from which a triangle has its full opacity, px; smaller ones fade smoothly; 0 never fades.
    pub fade_px: f32,
    /// Bound on the steepness of the window: ∂I/∂ratio is taken at a ratio of at least this; 0 is exact.
    pub ratio_least: f32,
    /// Whether depth, normal and distortion are drawn too.
    pub geometry: bool,
    /// Depths mapped to 0 and 1 before the distortion is taken (0.2 and 100 in the reference code).
    pub depth_range: [f32; 2],
    /// Whether the weights for [`Soft::accumulate_importance`](super::Soft::accumulate_importance) are summed.
    pub importance: bool,
}

impl Default for SoftOptions {
    fn default() -> Self {
        Self {
            window: Window::Soft,
            background: [0.0; 3],
            linear: false,
            sort: Sort::Tile,
            alpha_cap: 0.99,
            cutoff: 1.0 / 255.0,
            min_transmittance: 1e-4,
            exact_incenter: true,
            near: 0.01,
            fade_px: 0.5,
            ratio_least: 1e-3,
            geometry: false,
            depth_range: [0.2, 100.0],
            importance: false,
        }
    }
}

impl SoftOptions {
    /// With the alpha cap raised to the least of these opacities, as it is at the end of training: a soup that is solid
    /// throughout is drawn without a leak. `[N]`
    pub fn with_cap_for(self, opacity: &[f32]) -> Self {
        let least = opacity.iter().copied().fold(1.0, f32::min);
        Self { alpha_cap: self.alpha_cap.max(least), ..self }
    }

    /// The background as it is blended.
    pub(super) fn blended_background(&self) -> [f32; 3] {
        if self.linear { self.background.map(linear_from_srgb) } else { self.background }
    }
}
