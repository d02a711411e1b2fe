//! Where the soup lives while it trains. Only the inner loop has several homes: refinement takes the
//! state out, runs the one implementation there is, and puts it back.

use super::params::State;
use super::schedule::Rates;
use crate::camera::Camera;
use crate::error::Result;
use crate::raster::soft::Importance;

/// A photo as one step sees it.
#[derive(Debug, Clone, Copy)]
pub struct Shot<'a> {
    /// The camera, in training space, at the photo's size.
    pub camera: &'a Camera,
    /// The photo, sRGB-encoded. `[H * W]`
    pub photo: &'a [[f32; 3]],
    /// How much each pixel counts; `None` when all do. `[H * W]`
    pub weight: Option<&'a [f32]>,
    /// The photo is drawn for the first time since [`Backend::sightings`] was reset.
    pub first: bool,
}

/// What one step found.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct StepStats {
    /// The photometric loss.
    pub loss: f64,
    /// Mean squared error.
    pub mse: f64,
    /// Triangles whose gradient was not finite and therefore dropped.
    pub dropped: u64,
    /// Triangles that had a gradient.
    pub touched: u64,
}

/// What was seen of every triangle since the last reset.
#[derive(Debug, Clone, Default)]
pub struct Sightings {
    /// In photos drawn for the first time.
    pub first: Importance,
    /// In photos drawn again.
    pub again: Importance,
    /// Squared error of the pixels, shared out by weight, in units of 2^-20 px: whole numbers, so that the sum
    /// is the same however it is broken up. `[N]`
    pub error: Vec<u64>,
}

/// One home of the training scene. After k steps two homes agree.
pub trait Backend {
    /// Moves a state in.
    fn load(&mut self, state: State) -> Result<()>;
    /// Draws, compares, differentiates and moves the parameters once.
    fn step(&mut self, shot: &Shot<'_>, rates: &Rates) -> Result<StepStats>;
    /// Hands out what was seen since the last call and begins anew.
    fn sightings(&mut self) -> Result<Sightings>;
    /// Moves the state out; [`Backend::load`] must follow before the next step.
    fn store(&mut self) -> Result<State>;
    /// Triangles held.
    fn len(&self) -> usize;
    /// True when it holds none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
