//! Storage and optimisation of the scene while it trains.
//!
//! There are two backends, [`CpuBackend`](super::cpu::CpuBackend) and, with the feature `gpu`, one
//! on a graphics card (`train::gpu::GpuBackend`); `crates/train/tests/train/gpu` compares them. A backend runs
//! only the inner loop. Densification exists once: it takes the state out, changes it and puts it
//! back.

use super::params::{OptimizerState, Params};
use super::schedule::StepParams;
use glam::UVec2;
use std::borrow::Cow;
use trisplat_raster::soft::{Frame, Importance, SoftOptions};
use trisplat_scene::camera::Camera;
use trisplat_scene::image::RgbImage;
use trisplat_scene::{Error, Result};

/// A photo of one step.
#[derive(Debug, Clone, Copy)]
pub struct StepPhoto<'a> {
    /// The camera, in training space, at the photo's size.
    pub camera: &'a Camera,
    /// The pixels; alpha is the weight of each. `[H * W]`
    pub pixels: &'a RgbImage,
    /// The photo is drawn for the first time since the visibility statistics were reset.
    pub first: bool,
    /// Its identity, for a backend that keeps photos; `None` for a photo of one step only.
    pub id: Option<PhotoId>,
}

/// Identifies a photo at a size and an exposure. Equal ids have the same pixels for a whole run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct PhotoId {
    /// Number of the photo.
    pub index: usize,
    /// Number of times that it was halved.
    pub level: u32,
    /// True with a corrected exposure.
    pub corrected: bool,
}

/// Figures of one step.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StepStats {
    /// The photometric loss.
    pub loss: f64,
    /// Mean squared error.
    pub mse: f64,
    /// Triangles whose gradient was not finite and therefore dropped.
    pub dropped: u64,
    /// Updated triangles: with `rates.sparse` those with a gradient, else all.
    pub touched: u64,
}

/// Visibility of every triangle since the last call of [`TrainBackend::take_visibility`].
#[derive(Debug, Clone, Default)]
pub struct BackendVisibility {
    /// In photos drawn for the first time.
    pub first: Importance,
    /// In photos drawn again.
    pub again: Importance,
    /// Squared error of the pixels, shared out by weight, in units of 2^-20 px: integers, so that
    /// the sum does not depend on its order. `[N]`
    pub error: Vec<u64>,
}

/// The final size of a run, which determines its memory.
#[derive(Debug, Clone, Copy)]
#[cfg_attr(not(feature = "gpu"), expect(dead_code))]
pub(crate) struct RunSize {
    /// Maximum number of triangles.
    pub(crate) triangles: u64,
    /// Degree of the view-dependent colour.
    pub(crate) sh_degree: u8,
    /// The largest photo, px.
    pub(crate) photo: UVec2,
    /// All training photos together, px.
    pub(crate) photo_pixels: u64,
}

/// Stores a training scene and makes its steps.
pub trait TrainBackend: std::fmt::Debug {
    /// Moves a state in.
    fn load(&mut self, state: OptimizerState) -> Result<()>;
    /// Draws, compares, differentiates and updates the parameters once. A backend may run some
    /// steps behind; it catches up before it returns other data. An error may come from an earlier
    /// step.
    fn step(&mut self, photo: &StepPhoto<'_>, rates: &StepParams) -> Result<()>;
    /// Figures of finished steps, each once, in the order of the steps; with `all`, it waits for
    /// unfinished ones.
    fn figures(&mut self, all: bool) -> Result<Vec<StepStats>>;
    /// Returns and resets the visibility since the last call.
    fn take_visibility(&mut self) -> Result<BackendVisibility>;
    /// Moves the state out; [`TrainBackend::load`] must follow before the next step.
    fn store(&mut self) -> Result<OptimizerState>;
    /// The parameters as they are.
    fn params(&mut self) -> Result<Cow<'_, Params>>;
    /// True if the state can get lost: then [`TrainBackend::rescued`] has it.
    fn can_be_lost(&self) -> bool {
        false
    }
    /// The last loaded state, for when [`TrainBackend::store`] or the loading failed. It can be
    /// taken once.
    fn rescued(&mut self) -> Option<OptimizerState> {
        None
    }
    /// True where [`TrainBackend::picture`] draws the scene faster than the CPU.
    fn draws(&self) -> bool {
        false
    }
    /// The view of `camera`, in training space, drawn with `drawing` at a step of `rates`: colour
    /// and transmittance.
    fn picture(
        &mut self,
        _camera: &Camera,
        _drawing: &SoftOptions,
        _rates: &StepParams,
    ) -> Result<Frame> {
        Err(Error::Gpu("the CPU draws pictures of a soup".into()))
    }
    /// Triangles held.
    fn len(&self) -> usize;
    /// True when it holds none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
