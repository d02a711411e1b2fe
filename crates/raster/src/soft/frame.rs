//! Inputs and outputs of the soft rasteriser: options and a soup in, a frame out, and the gradients
//! of both.

use glam::{UVec2, Vec3};
use std::ops::Range;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::sh_count;

/// The order of blending the layers of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Sort {
    /// By the depth of the triangles' centroids, the same for all pixels; ties by index.
    #[default]
    Tile,
    /// By the depth of the triangles' planes at each pixel; ties by the order of `Tile`.
    Pixel,
}

/// The window of a triangle at its edges.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Window {
    /// Held et al. 2025, eq. 1.
    #[default]
    Soft,
    /// The covered part of each pixel, as in an engine's antialiased picture; σ and the fade have
    /// no effect.
    Coverage {
        /// Width of the ramp across an edge, px; 1 is a pixel's own filter.
        width_px: f32,
    },
}

/// Drawing options.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SoftOptions {
    /// The window of triangles at their edges.
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
    /// Inradius from which a triangle has its full opacity, px; smaller ones fade smoothly; 0 never
    /// fades.
    pub fade_px: f32,
    /// Minimum ratio at which ∂I/∂ratio is evaluated, which limits the steepness of the window; 0
    /// is exact.
    pub min_ratio: f32,
    /// Draw depth, normal and distortion too.
    pub geometry: bool,
    /// Depths that the distortion maps to 0 and 1 (0.2 and 100 in the reference code).
    pub depth_range: [f32; 2],
    /// Sum the weights for
    /// [`SoftRasterizer::accumulate_importance`](super::SoftRasterizer::accumulate_importance).
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
            min_ratio: 1e-3,
            geometry: false,
            depth_range: [0.2, 100.0],
            importance: false,
        }
    }
}

impl SoftOptions {
    /// Raises the alpha cap to the minimum of these opacities, as at the end of training, so
    /// that an entirely solid soup is drawn without leaks. `[N]`
    pub fn with_cap_for(self, opacity: &[f32]) -> Self {
        let min_opacity = opacity.iter().copied().fold(1.0, f32::min);
        Self { alpha_cap: self.alpha_cap.max(min_opacity), ..self }
    }

    /// The background in the encoding of blending.
    pub(super) fn blended_background(&self) -> [f32; 3] {
        if self.linear { self.background.map(linear_from_srgb) } else { self.background }
    }
}

/// The view of a camera. `[height * width]`, row by row
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Frame {
    /// Width and height, px.
    pub size: UVec2,
    /// Colour, background included; not clamped above. sRGB-encoded unless
    /// [`SoftOptions::linear`](super::SoftOptions::linear).
    pub rgb: Vec<[f32; 3]>,
    /// Transmittance T behind the last layer: the visible part of the background.
    pub transmittance: Vec<f32>,
    /// Σ w z; divide by 1 - transmittance for the expected depth. Empty unless requested.
    pub depth: Vec<f32>,
    /// Depth at which the transmittance falls below 1/2, 0 where it never does. Empty unless
    /// requested.
    pub median_depth: Vec<f32>,
    /// Σ w n in camera space, n towards the camera. Empty unless requested.
    pub normal: Vec<[f32; 3]>,
    /// Σ_{j<k} w_j w_k (m_j - m_k)², m the mapped depth. Empty unless requested.
    pub distortion: Vec<f32>,
}

impl Frame {
    /// The colours in 8 bits: clamped to [0, 1] and rounded. They must be sRGB-encoded.
    pub fn to_pixels(&self) -> RgbImage {
        RgbImage::from_rgb(self.size, &self.rgb)
    }

    /// The same, with the covered share of each pixel as its alpha, unless all are covered.
    pub fn to_cut_pixels(&self) -> RgbImage {
        let cover = |t: &f32| ((1.0 - t).clamp(0.0, 1.0) * 255.0).round() as u8;
        let alpha: Vec<u8> = self.transmittance.iter().map(cover).collect();
        let covered = alpha.iter().all(|a| *a == 255);
        RgbImage { alpha: (!covered).then_some(alpha), ..self.to_pixels() }
    }
}

/// Gradient of a loss L with respect to a [`Frame`]; empty means zero, except `d_rgb`, which is
/// always needed.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct FrameGrad {
    /// ∂L/∂rgb. `[height * width]`
    pub d_rgb: Vec<[f32; 3]>,
    /// ∂L/∂transmittance.
    pub d_transmittance: Vec<f32>,
    /// ∂L/∂depth.
    pub d_depth: Vec<f32>,
    /// ∂L/∂median_depth; reaches the plane of the triangle that holds the median.
    pub d_median_depth: Vec<f32>,
    /// ∂L/∂normal.
    pub d_normal: Vec<[f32; 3]>,
    /// ∂L/∂distortion.
    pub d_distortion: Vec<f32>,
    /// Not a gradient: an error per pixel, which is distributed over the triangles there by weight.
    pub error: Vec<f32>,
}

/// A borrowed soup, so that a trainer may keep its own layout.
#[derive(Debug, Clone, Copy)]
pub struct SoupRef<'a> {
    /// Corners in world units. `[N, 3]`
    pub vertices: &'a [[Vec3; 3]],
    /// Opacity o in [0, 1]. `[N]`
    pub opacity: &'a [f32],
    /// Window exponent σ > 0. `[N]`
    pub sigma: &'a [f32],
    /// Spherical harmonics, degree 0 first. `[N * K]`
    pub sh: &'a [[f32; 3]],
    /// Degree stored: K = (degree + 1)².
    pub sh_degree: u8,
    /// Degree used, at most the stored one.
    pub active_degree: u8,
}

impl<'a> SoupRef<'a> {
    /// Number of triangles.
    pub fn count(&self) -> usize {
        self.vertices.len()
    }

    /// Coefficients per triangle: K = (degree + 1)².
    pub fn sh_count(&self) -> usize {
        sh_count(self.sh_degree)
    }

    /// The coefficients of a triangle that are in use.
    #[inline]
    pub(super) fn active_sh(&self, triangle: usize) -> &'a [[f32; 3]] {
        let k = self.sh_count();
        let used = sh_count(self.active_degree.min(self.sh_degree));
        &self.sh[triangle * k..triangle * k + used]
    }
}

impl<'a> From<&'a trisplat_scene::Soup> for SoupRef<'a> {
    fn from(soup: &'a trisplat_scene::Soup) -> Self {
        Self {
            vertices: &soup.vertices,
            opacity: &soup.opacity,
            sigma: &soup.sigma,
            sh: &soup.sh,
            sh_degree: soup.sh_degree,
            active_degree: soup.sh_degree,
        }
    }
}

/// Gradient of a loss L with respect to a soup; rows of triangles that are not `visible` are zero.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct SoupGrad {
    /// ∂L/∂vertices. `[N, 3]`
    pub vertices: Vec<[Vec3; 3]>,
    /// ∂L/∂opacity. `[N]`
    pub opacity: Vec<f32>,
    /// ∂L/∂sigma. `[N]`
    pub sigma: Vec<f32>,
    /// ∂L/∂sh. `[N * K]`
    pub sh: Vec<[f32; 3]>,
    /// Each triangle's share of [`FrameGrad::error`](super::FrameGrad::error), Σ w error over the
    /// pixels. `[N]`
    pub error: Vec<f32>,
    /// Triangles that were drawn on at least one pixel, ascending.
    pub visible: Vec<u32>,
    /// Triangles whose gradient was not finite; their rows were set to zero.
    pub dropped: usize,
}

impl SoupGrad {
    /// The visible triangles in a range.
    pub fn visible_in(&self, triangles: Range<usize>) -> &[u32] {
        let at = |end: usize| self.visible.partition_point(|&t| (t as usize) < end);
        &self.visible[at(triangles.start)..at(triangles.end)]
    }
}
