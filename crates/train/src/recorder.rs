//! The record of a training: means and times of its samples, its checkpoints and its previews.

use super::backend::StepStats;
use super::budget::Correction;
use super::checkpoint::{self, Checkpoint};
use super::densify::Densified;
use super::eval::{Evaluator, TrainSample};
use super::inputs::{PREVIEW_PREFIX, Preview, TrainOutputs};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;
use trisplat_scene::image::RgbImage;
use trisplat_scene::process::cpu_secs;
use trisplat_scene::{Error, ImportedScene, Result};

/// Records a training and tells its observer.
pub(super) struct Recorder<'a> {
    observer: TrainObserver<'a>,
    outputs: TrainOutputs,
    /// The observer asked to stop the training.
    pub(super) stop_requested: bool,
    pub(super) evaluator: Evaluator,
    sums: StepSums,
    /// Means of the last steps with figures.
    means: Option<StepMeans>,
    cpu_start: f64,
    wall_start: Instant,
    last_preview: Instant,
    /// Step and path of the last checkpoint that was written.
    pub(super) checkpoint: Option<(u64, PathBuf)>,
    /// Outputs that could not be written.
    pub(super) lost: Vec<String>,
}

/// Sums over the steps since the last sample.
#[derive(Debug, Default)]
struct StepSums {
    loss: f64,
    /// Of the mean squared errors.
    mse: f64,
    steps: u64,
}

/// Means over some steps.
#[derive(Debug, Clone, Copy, Default)]
struct StepMeans {
    loss: f64,
    /// Of the mean squared error, dB.
    psnr: f64,
}

impl<'a> Recorder<'a> {
    /// Starts the clocks after `cpu_secs_before` CPU seconds of training. Decoding the held-out
    /// photos of `evaluator` is no training.
    pub(super) fn new(
        evaluator: Evaluator,
        outputs: TrainOutputs,
        cpu_secs_before: f64,
        observer: TrainObserver<'a>,
    ) -> Self {
        Self {
            observer,
            outputs,
            stop_requested: false,
            evaluator,
            sums: StepSums::default(),
            means: None,
            cpu_start: cpu_secs() - cpu_secs_before,
            wall_start: Instant::now(),
            last_preview: Instant::now(),
            checkpoint: None,
            lost: Vec::new(),
        }
    }

    /// Tells the observer.
    pub(super) fn tell(&mut self, event: TrainEvent<'_>) {
        self.stop_requested |= (self.observer)(event).is_break();
    }

    /// True until the figures of a step are recorded.
    pub(super) fn needs_figures(&self) -> bool {
        self.means.is_none()
    }

    /// Adds the figures of finished steps.
    pub(super) fn add_figures(&mut self, figures: &[StepStats]) {
        for stats in figures {
            self.sums.loss += stats.loss;
            self.sums.mse += stats.mse;
            self.sums.steps += 1;
        }
        if self.sums.steps > 0 {
            let n = self.sums.steps as f64;
            let psnr = -10.0 * (self.sums.mse / n).max(1e-12).log10();
            self.means = Some(StepMeans { loss: self.sums.loss / n, psnr });
        }
    }

    /// Means over the steps since the last kept sample, and times; nothing else.
    pub(super) fn sample(&self) -> TrainSample {
        let StepMeans { loss, psnr } = self.means.unwrap_or_default();
        TrainSample {
            loss,
            psnr,
            cpu_secs: self.cpu_secs(),
            wall_secs: self.wall_start.elapsed().as_secs_f64(),
            ..TrainSample::default()
        }
    }

    /// Begins new means, after a sample that is kept.
    pub(super) fn reset_means(&mut self) {
        self.sums = StepSums::default();
    }

    /// CPU seconds of the training.
    pub(super) fn cpu_secs(&self) -> f64 {
        cpu_secs() - self.cpu_start
    }

    /// Runs `work` without counting its CPU time as training.
    pub(super) fn uncounted<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let before = cpu_secs();
        let value = work(self);
        self.cpu_start += cpu_secs() - before;
        value
    }

    /// True if the training writes checkpoints.
    pub(super) fn writes_checkpoints(&self) -> bool {
        self.outputs.checkpoint.is_some()
    }

    /// Writes a checkpoint; returns its step and path, or `None` where it is lost.
    pub(super) fn write_checkpoint(
        &mut self,
        checkpoint: Result<Checkpoint>,
    ) -> Option<(u64, PathBuf)> {
        let path = self.outputs.checkpoint.as_ref()?;
        let keep = self.outputs.keep;
        let written = checkpoint.and_then(|checkpoint| {
            Ok((checkpoint.meta.step, checkpoint::write_numbered(path, &checkpoint, keep)?))
        });
        match written {
            Ok(written) => {
                self.checkpoint = Some(written);
                self.checkpoint.clone()
            }
            Err(error) => {
                self.lose(&error);
                None
            }
        }
    }

    /// Writes a preview after `step` steps, if one is due; `draw` draws the first held-out photo.
    pub(super) fn preview(
        &mut self,
        step: u64,
        draw: impl FnOnce(&mut Evaluator) -> Result<Option<RgbImage>>,
    ) {
        let Some(Preview { folder, interval }) = self.outputs.preview.clone() else { return };
        if self.last_preview.elapsed() < interval || self.evaluator.views.is_empty() {
            return;
        }
        self.last_preview = Instant::now();
        let written = self.uncounted(|record| {
            std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
            match draw(&mut record.evaluator)? {
                Some(picture) => {
                    picture.save_png(folder.join(format!("{PREVIEW_PREFIX}{step:06}.png")))
                }
                None => Ok(()),
            }
        });
        if let Err(error) = written {
            self.lose(&error);
        }
    }

    /// Reports and remembers an output that could not be written; the training continues.
    fn lose(&mut self, error: &Error) {
        self.tell(TrainEvent::Lost(error));
        self.lost.push(error.to_string());
    }
}

/// An event of a training.
#[derive(Debug)]
pub enum TrainEvent<'a> {
    /// A step was made.
    Step {
        /// Loss and PSNR are means over the steps since the last sample with known figures; on a
        /// graphics card the last two steps are not known yet.
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

/// Receives events; `ControlFlow::Break` stops the training after the step, with a checkpoint.
pub type TrainObserver<'a> = &'a mut dyn FnMut(TrainEvent<'_>) -> ControlFlow<()>;
