//! The outputs during a run: the curve, evaluations on the held-out photos, checkpoints and
//! previews.

use super::budget::{Correction, Spending};
use super::checkpoint;
use super::densify::Densified;
use super::eval::{Evaluator, PhotoScore, Quality, TrainSample};
use super::start::{PREVIEW_PREFIX, Preview};
use super::training::Training;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::Instant;
use trisplat_scene::process::cpu_secs;
use trisplat_scene::{Error, ImportedScene, Result};

/// Measures a run and writes its checkpoints and previews.
pub(super) struct Recorder<'a> {
    observer: TrainObserver<'a>,
    /// The observer stops the run.
    pub(super) is_asked: bool,
    pub(super) evaluator: Evaluator,
    /// Sums of loss and squared error since the last sample, and their number of steps.
    sums: (f64, f64, u64),
    /// The last known means: loss, PSNR.
    known: Option<(f64, f64)>,
    cpu_start: f64,
    wall: Instant,
    previewed: Instant,
    /// The last checkpoint that was written, and its step.
    pub(super) checkpoint: Option<(u64, PathBuf)>,
    pub(super) lost: Vec<String>,
}

impl<'a> Recorder<'a> {
    /// Continues the records of `training`. Decodes the held-out photos.
    pub(super) fn new(training: &Training<'_>, observer: TrainObserver<'a>) -> Result<Self> {
        let held_out: Vec<_> = training.dataset.test().collect();
        Ok(Self {
            observer,
            is_asked: false,
            evaluator: Evaluator::new(&held_out, training.held_out_bytes)?,
            sums: Default::default(),
            known: None,
            // Decoding the held-out photos is not training.
            cpu_start: cpu_secs() - training.meta.cpu_secs,
            wall: Instant::now(),
            previewed: Instant::now(),
            checkpoint: None,
            lost: Vec::new(),
        })
    }

    /// Tells the observer.
    pub(super) fn tell(&mut self, event: TrainEvent<'_>) {
        self.is_asked |= (self.observer)(event).is_break();
    }

    /// The state after a step on a photo of `width_px`, averaged since the last sample: with `all`
    /// over all steps, else over those with known figures.
    pub(super) fn sample(
        &mut self,
        training: &mut Training<'_>,
        width_px: u32,
        all: bool,
    ) -> Result<TrainSample> {
        for stats in training.figures(all || self.known.is_none())? {
            let (loss, mse, steps) = self.sums;
            self.sums = (loss + stats.loss, mse + stats.mse, steps + 1);
        }
        if let (loss, mse, 1..) = self.sums {
            let n = self.sums.2 as f64;
            self.known = Some((loss / n, -10.0 * (mse / n).max(1e-12).log10()));
        }
        let (loss, psnr) = self.known.unwrap_or_default();
        Ok(TrainSample {
            step: training.steps(),
            triangles: training.triangles() as u64,
            loss,
            psnr,
            test_psnr: None,
            test_size: None,
            width_px,
            cpu_secs: self.cpu_secs(),
            wall_secs: self.wall.elapsed().as_secs_f64(),
            dropped: training.meta.dropped,
        })
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

    pub(super) fn keep(
        &mut self,
        mut now: TrainSample,
        training: &mut Training<'_>,
        evaluate: bool,
    ) -> Result<TrainSample> {
        if evaluate {
            let scores = self.uncounted(|run| run.scores(training, usize::MAX))?;
            now.test_psnr = Quality::mean(&scores).map(|quality| quality.psnr);
            now.test_size = now.test_psnr.and(self.evaluator.shrunk);
        }
        self.sums = Default::default();
        training.meta.curve.push(now);
        Ok(now)
    }

    /// Seconds on the clock of a budget for the evaluation at the end, by that of one photo, which
    /// counts too.
    pub(super) fn evaluation_secs(
        &mut self,
        training: &mut Training<'_>,
        clock: &Spending,
    ) -> Result<f64> {
        let before = clock.seconds();
        self.uncounted(|run| run.scores(training, 1))?;
        Ok((clock.seconds() - before) * (self.evaluator.views.len() + 1) as f64)
    }

    fn scores(&mut self, training: &mut Training<'_>, most: usize) -> Result<Vec<PhotoScore>> {
        if self.evaluator.views.is_empty() {
            return Ok(Vec::new());
        }
        let drawing = training.drawing();
        if training.draws(&drawing) {
            return self
                .evaluator
                .scores_of(most, &drawing, |camera, drawing| training.picture(camera, drawing));
        }
        let soup = training.soup()?;
        let space = training.space();
        self.evaluator.scores(most, &soup, &space, &drawing)
    }

    /// Writes a checkpoint, if the run has any; returns its step and path.
    pub(super) fn checkpoint(&mut self, training: &mut Training<'_>) -> Option<(u64, PathBuf)> {
        let path = training.outputs.checkpoint.clone()?;
        let keep = training.outputs.keep;
        let spent = self.cpu_secs();
        let written = training.checkpoint(spent).and_then(|checkpoint| {
            Ok((checkpoint.meta.step, checkpoint::write_kept(&path, &checkpoint, keep)?))
        });
        match written {
            Ok(written) => self.checkpoint = Some(written),
            Err(error) => {
                self.note(Err(error));
                return None;
            }
        }
        self.checkpoint.clone()
    }

    /// Draws a preview, if one is due.
    pub(super) fn preview(&mut self, training: &mut Training<'_>) {
        let Some(Preview { folder, interval }) = training.outputs.preview.clone() else { return };
        if self.previewed.elapsed() < interval || self.evaluator.views.is_empty() {
            return;
        }
        self.previewed = Instant::now();
        let step = training.steps();
        let written = self.uncounted(|run| {
            std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, e))?;
            let soup = training.soup()?;
            let space = training.space();
            let drawing = training.drawing();
            match run.evaluator.first_picture(&soup, &space, &drawing) {
                Some(picture) => {
                    picture.save_png(folder.join(format!("{PREVIEW_PREFIX}{step:06}.png")))
                }
                None => Ok(()),
            }
        });
        self.note(written);
    }

    /// A failed output is reported and remembered; the run continues.
    fn note(&mut self, written: Result<()>) {
        if let Err(error) = written {
            self.tell(TrainEvent::Lost(&error));
            self.lost.push(error.to_string());
        }
    }

    /// Evaluates the present scene, and ends the curve with the `last` step.
    pub(super) fn finish(
        &mut self,
        training: &mut Training<'_>,
        last: Option<TrainSample>,
    ) -> Result<Vec<PhotoScore>> {
        let scores = self.scores(training, usize::MAX)?;
        if let Some(last) = last {
            let test_psnr = Quality::mean(&scores).map(|quality| quality.psnr);
            let test_size = test_psnr.and(self.evaluator.shrunk);
            let now = TrainSample { test_psnr, test_size, ..last };
            training.meta.curve.pop_if(|kept| kept.step == now.step);
            training.meta.curve.push(now);
            self.tell(TrainEvent::Sampled(&now));
        }
        Ok(scores)
    }
}

/// What happens in a run.
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

/// Is told what happens; `ControlFlow::Break` stops the run after the step, with a checkpoint.
pub type TrainObserver<'a> = &'a mut dyn FnMut(TrainEvent<'_>) -> ControlFlow<()>;
