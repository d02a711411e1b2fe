//! The soft rasteriser (Held et al. 2025): window function, alpha blending, depth order; forward and backward.
//!
//! Accuracy, edge values and policies are in `docs/numerics.md`.

use crate::camera::Camera;
use crate::math::color::linear_from_srgb;
use crate::raster::backward::{self, GeometrySlot, Slot};
use crate::raster::forward::{self, TilePixels};
use crate::raster::gather;
use crate::raster::importance::{Importance, SlotWeight};
use crate::raster::project::Projection;
use crate::raster::tiles::Tiles;
use glam::{UVec2, Vec3};
use std::time::Instant;

/// A soup as the rasteriser reads it; borrowed, so that a trainer may keep its own layout.
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

impl SoupRef<'_> {
    /// Number of triangles.
    pub fn len(&self) -> usize {
        self.vertices.len()
    }

    /// True when there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.vertices.is_empty()
    }

    /// Coefficients per triangle: K = (degree + 1)².
    pub fn sh_count(&self) -> usize {
        (self.sh_degree as usize + 1).pow(2)
    }
}

impl<'a> From<&'a crate::soup::Soup> for SoupRef<'a> {
    fn from(soup: &'a crate::soup::Soup) -> Self {
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
    /// What distances from edges are measured in: how many of it an inradius of so many px is.
    #[inline(always)]
    pub(super) fn scale(self, inradius: f32) -> f32 {
        match self {
            Window::Soft => 1.0,
            Window::Coverage { width_px } => inradius / width_px,
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
    /// Largest alpha of a layer, in (0, 1]; 0.99 in the reference, 1 for solid triangles.
    pub alpha_cap: f32,
    /// Smallest o · I that is drawn: the one cutoff, of bounds and of pixels.
    pub cutoff: f32,
    /// A pixel ends with the layer that brings its transmittance below this.
    pub min_transmittance: f32,
    /// Whether gradients pass through φ(s) and the fade; false holds the inradius constant as the reference does.
    pub exact_incenter: bool,
    /// Depth of the near plane at which triangles are cut, world units, > 0.
    pub near: f32,
    /// Inradius from which a triangle has its full opacity, px; smaller ones fade smoothly; 0 never fades.
    pub fade_px: f32,
    /// Bound on the steepness of the window: ∂I/∂ratio is taken at a ratio of at least this; 0 is exact.
    pub ratio_least: f32,
    /// Whether depth, normal and distortion are drawn too.
    pub geometry: bool,
    /// Depths mapped to 0 and 1 before the distortion is taken (0.2 and 100 in the reference).
    pub depth_range: [f32; 2],
    /// Whether the weights for [`Soft::accumulate_importance`] are summed.
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
    /// The background as it is blended.
    pub(super) fn backdrop(&self) -> [f32; 3] {
        if self.linear { self.background.map(linear_from_srgb) } else { self.background }
    }
}

/// What a camera sees. `[height * width]`, row by row
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Frame {
    /// Width and height, px.
    pub size: UVec2,
    /// Colour, background included; not clamped above. sRGB-encoded unless [`SoftOptions::linear`].
    pub rgb: Vec<[f32; 3]>,
    /// Part of the background that is seen.
    pub transmittance: Vec<f32>,
    /// Σ w z; divide by 1 - transmittance for the expected depth. Empty unless asked for.
    pub depth: Vec<f32>,
    /// Depth at which the transmittance falls below 1/2, 0 where it never does. Empty unless asked for.
    pub median_depth: Vec<f32>,
    /// Σ w n in camera space, n towards the camera. Empty unless asked for.
    pub normal: Vec<[f32; 3]>,
    /// Σ_{j<k} w_j w_k (m_j - m_k)², m the mapped depth. Empty unless asked for.
    pub distortion: Vec<f32>,
}

/// ∂L of a [`Frame`]; empty means zero, except `d_rgb`, which is always needed.
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
    /// Not a gradient: how wrong each pixel is, shared out among the triangles it shows by their weights.
    pub error: Vec<f32>,
}

/// ∂L of a soup; rows of triangles that are not `visible` are zero.
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
    /// Each triangle's share of [`FrameGrad::error`], Σ w error over the pixels. `[N]`
    pub error: Vec<f32>,
    /// Triangles that were drawn on at least one pixel, ascending.
    pub visible: Vec<u32>,
    /// Triangles whose gradient was not finite; their rows were set to zero.
    pub dropped: usize,
}

/// The rasteriser: scratch memory that is reused from frame to frame.
#[derive(Debug, Default)]
pub struct Soft {
    pub(super) projection: Projection,
    pub(super) tiles: Tiles,
    pub(super) pixels: Vec<TilePixels>,
    pub(super) slots: Vec<Slot>,
    pub(super) geometry_slots: Vec<GeometrySlot>,
    pub(super) weights: Vec<SlotWeight>,
    frame: Frame,
    timings: Vec<(&'static str, f64)>,
}

/// A stopwatch for the parts of a frame.
struct Clock(Instant);

impl Clock {
    fn new() -> Self {
        Self(Instant::now())
    }

    fn lap(&mut self, part: &'static str, out: &mut Vec<(&'static str, f64)>) {
        let now = Instant::now();
        out.push((part, (now - self.0).as_secs_f64() * 1e3));
        self.0 = now;
    }
}

impl Soft {
    /// A rasteriser with nothing allocated yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Draws `soup` as `camera` sees it. The same bits for any number of threads.
    pub fn render(&mut self, soup: &SoupRef, camera: &Camera, options: &SoftOptions) -> &Frame {
        self.timings.clear();
        let mut clock = Clock::new();
        self.projection.project(soup, camera, options);
        clock.lap("project", &mut self.timings);
        self.projection.order();
        clock.lap("sort", &mut self.timings);
        self.tiles.bin(&self.projection.splats, camera.size, options.window);
        clock.lap("bin", &mut self.timings);
        forward::draw(self, options);
        clock.lap("forward", &mut self.timings);
        forward::assemble(&mut self.frame, &self.pixels, &self.tiles, options);
        clock.lap("assemble", &mut self.timings);
        &self.frame
    }

    /// Gradients of the frame just rendered; soup, camera and options must be those of the last
    /// [`render`](Self::render). Rows are overwritten, not added to.
    pub fn backward(
        &mut self,
        soup: &SoupRef,
        camera: &Camera,
        options: &SoftOptions,
        d: &FrameGrad,
        out: &mut SoupGrad,
    ) {
        let mut clock = Clock::new();
        backward::draw_grad(self, options, d);
        clock.lap("backward", &mut self.timings);
        gather::gather(self, soup, camera, options, out);
        clock.lap("gather", &mut self.timings);
    }

    /// The last frame drawn.
    pub fn frame(&self) -> &Frame {
        &self.frame
    }

    /// Adds the last frame, drawn with `options.importance`, to `out`, which is reset first when it is of
    /// another number of triangles.
    pub fn accumulate_importance(&self, out: &mut Importance) {
        out.accumulate(&self.projection, &self.tiles, &self.weights);
    }

    /// Wall time of every part of the last frame, ms.
    pub fn timings(&self) -> &[(&'static str, f64)] {
        &self.timings
    }

    /// Numbers of splats and of (splat, tile) pairs of the last frame.
    pub fn load(&self) -> (usize, usize) {
        (self.projection.splats.len(), self.tiles.entries.len())
    }
}
