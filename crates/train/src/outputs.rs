//! The outputs during a run: the curve, evaluations on the held-out photos, checkpoints and previews.

use super::backend::TrainBackend;
use super::budget::{Correction, Pace, Spending};
use super::checkpoint;
use super::densify::Densified;
use super::eval::{self, Evaluator, PhotoScore, Quality};
use super::trainer::Trainer;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::time::{Duration, Instant};
use trisplat_dataset::{Dataset, ShrunkSize};
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::process::cpu_secs;
use trisplat_scene::{Error, ImportedScene, Result};

/// The outputs during a run; none of them changes the result.
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// Where checkpoints go.
    pub checkpoint: Option<PathBuf>,
    /// Number of last checkpoints to keep, in separate files; 0 means 1.
    pub keep: u32,
    /// Steps between checkpoints; 0 writes one only when the run is stopped.
    pub checkpoint_every: u64,
    /// Steps between samples of the curve; 0 chooses 100 samples per run.
    pub sample_every: u64,
    /// Steps between evaluations on the held-out photos; 0 evaluates once, at the end.
    pub evaluate_every: u64,
    /// Pictures of the first held-out photo.
    pub preview: Option<Preview>,
    /// Stop after this many CPU seconds, as on request; 0 never.
    pub max_cpu_secs: f64,
}

/// The beginning of the names of previews.
pub const PREVIEW: &str = "step-";

/// Pictures of the first held-out photo while a scene trains.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Preview {
    /// Their folder; files are called `step-000500.png`.
    pub folder: PathBuf,
    /// Time between two of them.
    pub pause: Duration,
}

/// Averages since the last sample.
#[derive(Default)]
struct Means {
    loss: f64,
    mse: f64,
    steps: u64,
}

/// The records of a finished run.
pub(super) struct Recorded {
    pub(super) curve: Vec<TrainSample>,
    pub(super) scores: Vec<PhotoScore>,
    pub(super) samples: Option<u32>,
    pub(super) photo_size: Option<ShrunkSize>,
    pub(super) cpu_secs: f64,
    /// The last checkpoint that was written, and its step.
    pub(super) checkpoint: Option<(u64, PathBuf)>,
    pub(super) lost: Vec<String>,
}

/// Keeps the curve of a run and writes its checkpoints and previews.
pub(super) struct Recorder<'a> {
    observer: TrainObserver<'a>,
    /// The observer stops the run.
    pub(super) is_asked: bool,
    evaluator: Evaluator,
    drawing: SoftOptions,
    curve: Vec<TrainSample>,
    means: Means,
    /// The last known means: loss, PSNR.
    known: Option<(f64, f64)>,
    cpu_start: f64,
    wall: Instant,
    previewed: Instant,
    checkpoint: Option<(u64, PathBuf)>,
    lost: Vec<String>,
}

impl<'a> Recorder<'a> {
    /// Continues the `curve` of a run that has taken `cpu_secs_before`. Decodes the held-out photos;
    /// `photo_bytes` is the memory for them.
    pub(super) fn new(
        dataset: &Dataset,
        drawing: SoftOptions,
        curve: Vec<TrainSample>,
        cpu_secs_before: f64,
        photo_bytes: u64,
        observer: TrainObserver<'a>,
    ) -> Result<Self> {
        Ok(Self {
            observer,
            is_asked: false,
            evaluator: Evaluator::new(&dataset.test().collect::<Vec<_>>(), photo_bytes)?,
            drawing,
            curve,
            means: Means::default(),
            known: None,
            // Decoding the held-out photos is not training.
            cpu_start: cpu_secs() - cpu_secs_before,
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

    /// The state after a step on a photo of `width_px`, averaged since the last sample: with `all` over all
    /// steps, else over those with known figures.
    pub(super) fn sample<B: TrainBackend>(
        &mut self,
        trainer: &mut Trainer<B>,
        width_px: u32,
        all: bool,
    ) -> Result<TrainSample> {
        for stats in trainer.figures(all || self.known.is_none())? {
            self.means.loss += stats.loss;
            self.means.mse += stats.mse;
            self.means.steps += 1;
        }
        if self.means.steps > 0 {
            let n = self.means.steps as f64;
            let psnr = -10.0 * (self.means.mse / n).max(1e-12).log10();
            self.known = Some((self.means.loss / n, psnr));
        }
        let (loss, psnr) = self.known.unwrap_or_default();
        Ok(TrainSample {
            step: trainer.steps(),
            triangles: trainer.triangles() as u64,
            loss,
            psnr,
            test_psnr: None,
            test_size: None,
            width_px,
            cpu_secs: cpu_secs() - self.cpu_start,
            wall_secs: self.wall.elapsed().as_secs_f64(),
            dropped: trainer.dropped(),
        })
    }

    /// Runs `work` without counting its CPU time as training.
    pub(super) fn uncounted<T>(&mut self, work: impl FnOnce(&mut Self) -> T) -> T {
        let before = cpu_secs();
        let value = work(self);
        self.cpu_start += cpu_secs() - before;
        value
    }

    pub(super) fn keep<B: TrainBackend>(
        &mut self,
        mut now: TrainSample,
        trainer: &mut Trainer<B>,
        evaluate: bool,
    ) -> Result<TrainSample> {
        if evaluate {
            let scores = self.uncounted(|run| run.scores(trainer, usize::MAX))?;
            now.test_psnr = Quality::mean(&scores).map(|quality| quality.psnr);
            now.test_size = now.test_psnr.and(self.evaluator.shrunk_size());
        }
        self.means = Means::default();
        self.curve.push(now);
        Ok(now)
    }

    /// Seconds on the clock of a budget for the evaluation at the end, by that of one photo, which counts too.
    pub(super) fn evaluation_secs<B: TrainBackend>(
        &mut self,
        trainer: &mut Trainer<B>,
        clock: &Spending,
    ) -> Result<f64> {
        let before = clock.seconds();
        self.uncounted(|run| run.scores(trainer, 1))?;
        Ok((clock.seconds() - before) * (self.evaluator.len() + 1) as f64)
    }

    fn scores<B: TrainBackend>(&mut self, trainer: &mut Trainer<B>, most: usize) -> Result<Vec<PhotoScore>> {
        if self.evaluator.is_empty() {
            return Ok(Vec::new());
        }
        let drawing = trainer.drawing(&self.drawing);
        if trainer.draws(&drawing) {
            return self
                .evaluator
                .scores_of(most, &drawing, |camera, drawing| trainer.picture(camera, drawing));
        }
        let (soup, space) = (trainer.soup()?, trainer.space());
        self.evaluator.scores(most, &soup, &space, &drawing)
    }

    /// Writes a checkpoint, if the run has any; returns its step and path.
    pub(super) fn checkpoint<B: TrainBackend>(
        &mut self,
        trainer: &mut Trainer<B>,
        outputs: &RunOptions,
        pace: Option<Pace>,
    ) -> Option<(u64, PathBuf)> {
        let path = outputs.checkpoint.as_ref()?;
        let spent = cpu_secs() - self.cpu_start;
        let written = trainer.checkpoint(&self.curve, spent).and_then(|mut checkpoint| {
            checkpoint.meta.pace = pace;
            Ok((checkpoint.meta.step, checkpoint::write_kept(path, &checkpoint, outputs.keep)?))
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
    pub(super) fn preview<B: TrainBackend>(&mut self, trainer: &mut Trainer<B>, outputs: &RunOptions) {
        let Some(Preview { folder, pause }) = &outputs.preview else { return };
        if self.previewed.elapsed() < *pause || self.evaluator.is_empty() {
            return;
        }
        self.previewed = Instant::now();
        let step = trainer.steps();
        let written = self.uncounted(|run| {
            std::fs::create_dir_all(folder).map_err(|e| Error::io(folder, e))?;
            let (soup, space, drawing) = (trainer.soup()?, trainer.space(), trainer.drawing(&run.drawing));
            match run.evaluator.first_picture(&soup, &space, &drawing) {
                Some(picture) => picture.save_png(folder.join(format!("{PREVIEW}{step:06}.png"))),
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
    pub(super) fn finish<B: TrainBackend>(
        mut self,
        trainer: &mut Trainer<B>,
        last: Option<TrainSample>,
    ) -> Result<Recorded> {
        let spent = cpu_secs() - self.cpu_start;
        let scores = self.scores(trainer, usize::MAX)?;
        if let Some(last) = last {
            let test_psnr = Quality::mean(&scores).map(|quality| quality.psnr);
            let test_size = test_psnr.and(self.evaluator.shrunk_size());
            let now = TrainSample { test_psnr, test_size, ..last };
            let again = self.curve.last().is_some_and(|kept| kept.step == now.step);
            self.curve.truncate(self.curve.len() - usize::from(again));
            self.curve.push(now);
            self.tell(TrainEvent::Sampled(&now));
        }
        let samples = eval::solid_samples(&trainer.drawing(&self.drawing));
        Ok(Recorded {
            photo_size: self.evaluator.shrunk_size(),
            curve: self.curve,
            scores,
            samples,
            cpu_secs: spent,
            checkpoint: self.checkpoint,
            lost: self.lost,
        })
    }
}

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
