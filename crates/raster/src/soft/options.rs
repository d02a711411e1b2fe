//! How the soft rasteriser draws.

use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::math::real::Real;

/// The order of blending the layers of a pixel.
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
    /// The covered part of each pixel, as in an engine's antialiased picture; σ and the fade have no effect.
    Coverage {
        /// Width of the ramp across an edge, px; 1 is a pixel's own filter.
        width_px: f32,
    },
}

impl Window {
    /// Converts an inradius, px, to this window's unit of distance from edges.
    #[inline(always)]
    pub(super) fn scale<R: Real>(self, inradius: R) -> R {
        match self {
            Window::Soft => R::of(1.0),
            Window::Coverage { width_px } => inradius / R::of(width_px.into()),
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
    /// Blend in linear light, as engines do: colours are decoded first, and the frame stays linear.
    pub linear: bool,
    /// Blending order.
    pub sort: Sort,
    /// Largest alpha of a layer, in (0, 1]; 0.99 in the reference code, 1 for solid triangles.
    pub alpha_cap: f32,
    /// Smallest o · I that is drawn: the only cutoff, for bounds and pixels.
    pub cutoff: f32,
    /// A pixel terminates with the layer that brings its transmittance below this.
    pub min_transmittance: f32,
    /// Depth of the near plane at which triangles are clipped, world units, > 0.
    pub near: f32,
    /// Inradius from which a triangle has its full opacity, px; smaller ones fade smoothly; 0 never fades.
    pub fade_px: f32,
    /// Least ratio at which ∂I/∂ratio is evaluated, which limits the steepness of the window; 0 is exact.
    pub ratio_least: f32,
    /// Whether depth, normal and distortion are drawn too.
    pub geometry: bool,
    /// Depths that the distortion maps to 0 and 1 (0.2 and 100 in the reference code).
    pub depth_range: [f32; 2],
    /// Whether the weights for [`SoftRasterizer::accumulate_importance`](super::SoftRasterizer::accumulate_importance) are summed.
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
    /// With the alpha cap raised to the least of these opacities, as at the end of training, so that an
    /// entirely solid soup is drawn without leaks. `[N]`
    pub fn with_cap_for(self, opacity: &[f32]) -> Self {
        let least = opacity.iter().copied().fold(1.0, f32::min);
        Self { alpha_cap: self.alpha_cap.max(least), ..self }
    }

    /// The background in the encoding of blending.
    pub(super) fn blended_background(&self) -> [f32; 3] {
        if self.linear { self.background.map(linear_from_srgb) } else { self.background }
    }
}
