//! Reports during a run, and the samples of its curve.

use super::budget::Correction;
use super::densify::Densified;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_dataset::ShrunkSize;
use trisplat_scene::{Error, ImportedScene};

/// The state of a run after some step: one point of its curve.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TrainSample {
    /// Steps made.
    pub step: u64,
    /// Triangles.
    pub triangles: u64,
    /// Loss, averaged over the last steps.
    pub loss: f64,
    /// PSNR on the training photos as drawn, averaged over the last steps, dB.
    pub psnr: f64,
    /// PSNR on the held-out photos, dB; only if measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_psnr: Option<f64>,
    /// The size that these photos were shrunk to, "320x213"; absent where they were not.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub test_size: Option<ShrunkSize>,
    /// Width of the last photo, px.
    pub width_px: u32,
    /// CPU seconds of the process, evaluation excluded.
    pub cpu_secs: f64,
    /// Wall-clock seconds since this process began training.
    pub wall_secs: f64,
    /// Gradients dropped so far because they were not finite.
    pub dropped: u64,
}

/// Called during a run; every method does nothing unless implemented.
pub trait TrainObserver {
    /// Called after every step. Loss and PSNR are means over the steps since the last sample with known
    /// figures; on a graphics card the last two steps are not known yet.
    fn stepped(&mut self, _sample: &TrainSample) {}
    /// A sample of the curve; its loss and PSNR are means since the last one.
    fn sampled(&mut self, _sample: &TrainSample) {}
    /// The scene was densified.
    fn densified(&mut self, _step: u64, _refined: &Densified) {}
    /// The budget changed the planned number of steps.
    fn corrected(&mut self, _correction: &Correction) {}
    /// A checkpoint or a preview could not be written; the run continues.
    fn lost(&mut self, _error: &Error) {}
    /// Called between steps: true passes a copy of the present scene to [`TrainObserver::scene`].
    fn wants_scene(&mut self) -> bool {
        false
    }
    /// The scene after the step of `sample`, as in its file.
    fn scene(&mut self, _sample: &TrainSample, _scene: ImportedScene) {}
    /// Called between steps: true stops the run after a checkpoint.
    fn wants_to_stop(&mut self) -> bool {
        false
    }
}

/// Observes nothing.
impl TrainObserver for () {}
