//! The training scene in main memory, on all cores.

use super::backend::{BackendVisibility, StepPhoto, StepStats, TrainBackend};
use super::params::{Anneal, OptimizerState, Params, frozen_opacity};
use super::schedule::StepParams;
use super::update::{Regularisers, update};
use std::borrow::Cow;
use trisplat_raster::kernel::loss::{Photometric, Scratch, photometric_grad};
use trisplat_raster::kernel::normal::{Maps, MapsGrad, normal_grad};
use trisplat_raster::soft::{
    CountedPixels, Frame, FrameGrad, SoftOptions, SoftRasterizer, SoupGrad, SoupRef,
};
use trisplat_scene::Result;
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::math::color::encode;
use trisplat_scene::math::lanes::{LANES, Lanes, Work, dispatch};
use trisplat_scene::parallel::{self, GRAIN};

/// A training scene in main memory.
#[derive(Debug, Default)]
pub struct CpuBackend {
    options: SoftOptions,
    state: OptimizerState,
    soft: SoftRasterizer,
    frame_loss: FrameLoss,
    d_maps: MapsGrad<f32>,
    d_frame: FrameGrad,
    d_soup: SoupGrad,
    opacity: Vec<f32>,
    sigma: Vec<f32>,
    visibility: BackendVisibility,
    figures: Vec<StepStats>,
}

impl CpuBackend {
    /// A backend without a scene; draws with `options`.
    pub fn new(options: SoftOptions) -> Self {
        Self { options: SoftOptions { importance: true, ..options }, ..Self::default() }
    }
}

impl TrainBackend for CpuBackend {
    fn load(&mut self, state: OptimizerState) -> Result<()> {
        self.state = state;
        Ok(())
    }

    fn store(&mut self) -> Result<OptimizerState> {
        Ok(std::mem::take(&mut self.state))
    }

    fn params(&mut self) -> Result<Cow<'_, Params>> {
        Ok(Cow::Borrowed(&self.state.params))
    }

    fn len(&self) -> usize {
        self.state.params.len()
    }

    fn take_visibility(&mut self) -> Result<BackendVisibility> {
        Ok(std::mem::take(&mut self.visibility))
    }

    fn figures(&mut self, _all: bool) -> Result<Vec<StepStats>> {
        Ok(std::mem::take(&mut self.figures))
    }

    fn step(&mut self, photo: &StepPhoto<'_>, rates: &StepParams) -> Result<()> {
        activate(&self.state, rates, &mut self.opacity, &mut self.sigma);
        let params = &self.state.params;
        let soup = SoupRef {
            vertices: &params.vertices,
            opacity: &self.opacity,
            sigma: &self.sigma,
            sh: &params.sh,
            sh_degree: params.sh_degree,
            active_degree: rates.sh_degree.min(params.sh_degree),
        };
        let mut options = rates.drawing(&self.options);
        options.geometry = rates.beta_normal > 0.0 || rates.beta_distortion > 0.0;
        let camera = photo.camera;
        let width = photo.pixels.size.x;
        let counted = photo.pixels.alpha.as_deref().map(|alpha| CountedPixels { alpha, width });
        let frame = self.soft.render_counting(&soup, camera, &options, counted);
        let dssim = rates.dssim;
        let d_rgb = &mut self.d_frame.d_rgb;
        let means = self.frame_loss.photometric_grad(
            photo.pixels,
            dssim,
            options.linear,
            &frame.rgb,
            d_rgb,
        );
        self.frame_loss.errors(&mut self.d_frame.error);
        let geometry = geometry_grad(frame, camera, rates, &mut self.d_maps, &mut self.d_frame);
        self.soft.backward(&soup, camera, &options, &self.d_frame, &mut self.d_soup);
        let importance =
            if photo.first { &mut self.visibility.first } else { &mut self.visibility.again };
        self.soft.accumulate_importance(importance);
        add_errors(&self.d_soup, &mut self.visibility.error);
        let regularisers = Regularisers::new(&self.state, rates);
        let (touched, broken) = update(&mut self.state, &self.d_soup, rates, &regularisers);
        self.figures.push(StepStats {
            loss: means.value(rates.dssim) + geometry,
            mse: means.mse,
            touched,
            dropped: broken + self.d_soup.dropped as u64,
        });
        Ok(())
    }
}

/// The losses on depth and normals (Held et al. 2025, eq. 3: β2 and β3), with their gradients in
/// `d`.
fn geometry_grad(
    frame: &Frame,
    camera: &Camera,
    rates: &StepParams,
    d_maps: &mut MapsGrad<f32>,
    d: &mut FrameGrad,
) -> f64 {
    for map in [&mut d.d_depth, &mut d.d_transmittance, &mut d.d_distortion] {
        map.clear();
    }
    d.d_normal.clear();
    let mut loss = 0.0;
    if rates.beta_distortion > 0.0 {
        let scale = rates.beta_distortion / frame.distortion.len().max(1) as f64;
        loss += scale * frame.distortion.iter().map(|&x| f64::from(x)).sum::<f64>();
        d.d_distortion.resize(frame.distortion.len(), scale as f32);
    }
    if rates.beta_normal > 0.0 {
        let maps = Maps {
            width: camera.size.x as usize,
            focal: camera.focal.to_array(),
            center: camera.center.to_array(),
            depth: &frame.depth,
            transmittance: &frame.transmittance,
            normal: &frame.normal,
        };
        loss += normal_grad(&maps, rates.beta_normal, d_maps);
        std::mem::swap(&mut d.d_depth, &mut d_maps.d_depth);
        std::mem::swap(&mut d.d_transmittance, &mut d_maps.d_transmittance);
        std::mem::swap(&mut d.d_normal, &mut d_maps.d_normal);
    }
    loss
}

/// Adds each triangle's share of the error.
fn add_errors(d_soup: &SoupGrad, errors: &mut Vec<u64>) {
    if errors.len() != d_soup.error.len() {
        errors.clear();
        errors.resize(d_soup.error.len(), 0);
    }
    for &i in &d_soup.visible {
        let sum = &mut errors[i as usize];
        // A cast from a float saturates, and turns NaN into 0.
        *sum = sum.saturating_add((d_soup.error[i as usize] * ERROR_UNITS) as u64);
    }
}

/// Units of [`BackendVisibility::error`] per pixel.
pub(super) const ERROR_UNITS: f32 = 1_048_576.0;

/// Opacity and σ of the raw parameters.
fn activate(
    state: &OptimizerState,
    rates: &StepParams,
    opacity: &mut Vec<f32>,
    sigma: &mut Vec<f32>,
) {
    // Frozen triangles are as solid as they will stay, whatever the anneal.
    let params = &state.params;
    let anneal = rates.anneal;
    opacity.clear();
    parallel::extend(opacity, params.opacity.len(), GRAIN, |i| {
        let o = params.opacity[i];
        let s = params.sigma[i];
        if i < state.frozen {
            frozen_opacity(o, s, rates.engine_shading)
        } else {
            anneal.opacity(o)
        }
    });
    sigma.clear();
    parallel::extend(sigma, params.sigma.len(), GRAIN, |i| {
        if i < state.frozen { Anneal::NONE } else { anneal }.sigma(params.sigma[i])
    });
}

/// Working memory.
#[derive(Debug, Default)]
pub(super) struct FrameLoss {
    scratch: Scratch<f32>,
    photo: FloatPhoto,
    /// The picture, sRGB-encoded. `[H * W]`
    picture: Vec<[f32; 3]>,
    /// ∂picture/∂frame; empty when it is 1.
    slope: Vec<[f32; 3]>,
}

impl FrameLoss {
    /// Returns the mean losses over the photo's pixels, and writes ∂loss/∂frame; the frame is in
    /// linear light if `linear`. `[H * W]`
    pub(super) fn photometric_grad(
        &mut self,
        pixels: &RgbImage,
        dssim: f64,
        linear: bool,
        frame: &[[f32; 3]],
        d_frame: &mut Vec<[f32; 3]>,
    ) -> Photometric {
        self.photo.read(pixels);
        self.picture.clear();
        self.picture.extend_from_slice(frame);
        self.slope.clear();
        if linear {
            self.slope.resize(self.picture.len(), [0.0; 3]);
            let rows = self.picture.chunks_mut(ROW).zip(self.slope.chunks_mut(ROW));
            parallel::for_each(rows, |_, (picture, slope)| {
                dispatch(Encode {
                    values: picture.as_flattened_mut(),
                    slope: slope.as_flattened_mut(),
                });
            });
        }
        let Self { scratch, photo, picture, slope } = self;
        d_frame.resize(picture.len(), [0.0; 3]);
        let width = pixels.size.x as usize;
        let rgb = &photo.rgb;
        let weight = photo.weight();
        let means = photometric_grad(width, picture, rgb, weight, dssim, scratch, d_frame);
        for (d, slope) in d_frame.as_flattened_mut().iter_mut().zip(slope.as_flattened()) {
            *d *= slope;
        }
        means
    }

    /// Squared error of each pixel, for the last frame and photo of [`Self::photometric_grad`].
    pub(super) fn errors(&self, out: &mut Vec<f32>) {
        let picture = &self.picture;
        let rgb = &self.photo.rgb;
        let weights = self.photo.weight();
        out.clear();
        parallel::extend(out, picture.len(), GRAIN, |i| {
            let d: [f32; 3] = std::array::from_fn(|c| picture[i][c] - rgb[i][c]);
            weights.map_or(1.0, |w| w[i]) * (d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
        });
    }
}

/// A photo in numbers from 0 to 1.
#[derive(Debug, Default)]
struct FloatPhoto {
    /// sRGB-encoded. `[H * W]`
    rgb: Vec<[f32; 3]>,
    /// Weight of each pixel; empty when all are 1. `[H * W]`
    weight: Vec<f32>,
}

impl FloatPhoto {
    fn read(&mut self, pixels: &RgbImage) {
        self.rgb.clear();
        self.rgb.extend(pixels.rgb.iter().map(|p| p.map(|c| f32::from(c) * (1.0 / 255.0))));
        self.weight.clear();
        self.weight.extend(pixels.alpha.iter().flatten().map(|&a| f32::from(a) * (1.0 / 255.0)));
    }

    fn weight(&self) -> Option<&[f32]> {
        (!self.weight.is_empty()).then_some(&self.weight)
    }
}

/// Pixels that one job encodes.
const ROW: usize = 4096;

/// Encodes channels in place and writes the slopes.
struct Encode<'a> {
    values: &'a mut [f32],
    slope: &'a mut [f32],
}

impl Work for Encode<'_> {
    type Output = ();
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let mut x = [0.0; LANES];
        let mut d = [0.0; LANES];
        for (values, slope) in self.values.chunks_mut(LANES).zip(self.slope.chunks_mut(LANES)) {
            x[..values.len()].copy_from_slice(values);
            let (encoded, by) = encode(L::load(&x));
            encoded.store(&mut x);
            by.store(&mut d);
            values.copy_from_slice(&x[..values.len()]);
            slope.copy_from_slice(&d[..slope.len()]);
        }
    }
}
