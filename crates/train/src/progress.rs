//! Reports during a run, and the samples of its curve.

use super::budget::Correction;
use super::densify::Densified;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
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

/// What happens in a run.
#[derive(Debug)]
pub enum TrainEvent<'a> {
    /// A step was made.
    Step {
        /// Loss and PSNR are means over the steps since the last sample with known figures; on a graphics card the last two
        /// steps are not known yet.
        sample: &'a TrainSample,
        /// Set it to get [`TrainEvent::Scene`] after this step.
        wants_scene: &'a mut bool,
    },
    /// A sample of the curve; its loss and PSNR are means since the last one.
    Sampled(&'a TrainSample),
    /// The scene was densified after this step.
    Densified(u64, &'a Densified),
    /// The budget changed the planned number of steps.
    Corrected(&'a Correction),
    /// A checkpoint or a preview could not be written; the run continues.
    Lost(&'a Error),
    /// A copy of the scene after the step of the sample, as in its file.
    Scene(&'a TrainSample, Box<ImportedScene>),
}

/// Is told what happens; `ControlFlow::Break` stops the run after the step, with a checkpoint.
pub type TrainObserver<'a> = &'a mut dyn FnMut(TrainEvent<'_>) -> ControlFlow<()>;
