//! The frame of the soft rasteriser, and the gradient of a loss with respect to it.

use glam::UVec2;
use trisplat_scene::image::RgbImage;

/// The view of a camera. `[height * width]`, row by row
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Frame {
    /// Width and height, px.
    pub size: UVec2,
    /// Colour, background included; not clamped above. sRGB-encoded unless [`SoftOptions::linear`](super::SoftOptions::linear).
    pub rgb: Vec<[f32; 3]>,
    /// Transmittance T behind the last layer: the visible part of the background.
    pub transmittance: Vec<f32>,
    /// Σ w z; divide by 1 - transmittance for the expected depth. Empty unless requested.
    pub depth: Vec<f32>,
    /// Depth at which the transmittance falls below 1/2, 0 where it never does. Empty unless requested.
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

/// Gradient of a loss L with respect to a [`Frame`]; empty means zero, except `d_rgb`, which is always needed.
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
