//! The training scene in main memory, on all cores.

use super::backend::{Backend, Shot, Sightings, StepStats};
use super::params::{Params, State};
use super::schedule::Rates;
use super::update::{Regularisers, update};
use crate::error::Result;
use crate::kernel::loss::{Scratch, photometric_grad};
use crate::raster::soft::{FrameGrad, Soft, SoftOptions, SoupGrad, SoupRef};
use rayon::prelude::*;

/// The CPU's home of a training scene.
#[derive(Debug, Default)]
pub struct Cpu {
    options: SoftOptions,
    state: State,
    soft: Soft,
    scratch: Scratch<f32>,
    d_frame: FrameGrad,
    d_soup: SoupGrad,
    opacity: Vec<f32>,
    sigma: Vec<f32>,
    sightings: Sightings,
}

impl Cpu {
    /// An empty home that draws with `options`.
    pub fn new(options: SoftOptions) -> Self {
        Self { options: SoftOptions { importance: true, ..options }, ..Self::default() }
    }
}

impl Backend for Cpu {
    fn load(&mut self, state: State) -> Result<()> {
        self.state = state;
        Ok(())
    }

    fn store(&mut self) -> Result<State> {
        Ok(std::mem::take(&mut self.state))
    }

    fn len(&self) -> usize {
        self.state.params.len()
    }

    fn sightings(&mut self) -> Result<Sightings> {
        Ok(std::mem::take(&mut self.sightings))
    }

    fn step(&mut self, shot: &Shot<'_>, rates: &Rates) -> Result<StepStats> {
        activate(&self.state.params, rates, &mut self.opacity, &mut self.sigma);
        let params = &self.state.params;
        let soup = SoupRef {
            vertices: &params.vertices,
            opacity: &self.opacity,
            sigma: &self.sigma,
            sh: &params.sh,
            sh_degree: params.sh_degree,
            active_degree: rates.sh_degree.min(params.sh_degree),
        };
        self.options.alpha_cap = rates.alpha_cap;
        let frame = self.soft.render(&soup, shot.camera, &self.options);
        let width = shot.camera.size.x as usize;
        self.d_frame.d_rgb.resize(shot.photo.len(), [0.0; 3]);
        let means = photometric_grad(
            width,
            &frame.rgb,
            shot.photo,
            shot.weight,
            rates.dssim,
            &mut self.scratch,
            &mut self.d_frame.d_rgb,
        );
        self.soft.backward(&soup, shot.camera, &self.options, &self.d_frame, &mut self.d_soup);
        let n = params.len();
        let sighting = if shot.first { &mut self.sightings.first } else { &mut self.sightings.again };
        if sighting.max_weight.len() != n {
            sighting.reset(n);
        }
        self.soft.accumulate_importance(sighting);
        let regularisers = Regularisers::new(&self.state.params, rates);
        let (touched, broken) = update(&mut self.state, &self.d_soup, rates, &regularisers);
        Ok(StepStats {
            loss: means.value(rates.dssim),
            mse: means.mse,
            touched,
            dropped: broken + self.d_soup.dropped as u64,
        })
    }
}

/// Opacity and σ of the raw parameters.
fn activate(params: &Params, rates: &Rates, opacity: &mut Vec<f32>, sigma: &mut Vec<f32>) {
    let anneal = rates.anneal;
    params.opacity.par_iter().with_min_len(4096).map(|&x| anneal.opacity(x)).collect_into_vec(opacity);
    params.sigma.par_iter().with_min_len(4096).map(|&x| anneal.sigma(x)).collect_into_vec(sigma);
}
