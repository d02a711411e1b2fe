//! The steps of a training to its end, with the samples, evaluations, checkpoints and corrections of
//! its budget that are due on the way.

use super::Training;
use crate::budget::BudgetControl;
use crate::eval::{Evaluator, PhotoScore, Quality, TrainSample, solid_samples};
use crate::recorder::{Recorder, TrainEvent, TrainObserver};
use crate::trained::Trained;
use std::path::PathBuf;
use trisplat_dataset::View;
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::camera::Camera;
use trisplat_scene::{Error, Result, Spending};

impl Training<'_> {
    /// Trains until the last step, or until `observer` stops it.
    ///
    /// # Errors
    ///
    /// Photos that cannot be decoded, with a checkpoint of all steps so far; a graphics card that
    /// is lost or out of memory, with one of the last densification or checkpoint at least.
    pub fn finish(mut self, observer: TrainObserver<'_>) -> Result<Trained> {
        let held_out: Vec<&View> = self.dataset.test().collect();
        let evaluator = Evaluator::new(&held_out, self.held_out_bytes)?;
        let cpu_secs = self.meta.cpu_secs;
        let mut record = Recorder::new(evaluator, self.outputs.clone(), cpu_secs, observer);
        let end = self.make_steps(&mut record)?;
        let cpu_secs = record.cpu_secs();
        let scores = self.final_scores(&mut record, end.last_sample)?;
        let (provenance, cameras) = self.origin();
        let (soup, not_finite) = self.final_soup()?;
        let samples = solid_samples(&self.drawing());
        let Self { meta, spending, .. } = self;
        let is_current = |(step, _): &(u64, _)| *step == meta.step;
        Ok(Trained {
            checkpoint: record.checkpoint.filter(is_current).map(|(_, path)| path),
            soup,
            provenance,
            cameras,
            steps: meta.step,
            options: meta.options,
            budget_control: meta
                .pace
                .zip(spending)
                .map(|(pace, spending)| BudgetControl { pace, spending }),
            curve: meta.curve,
            scores,
            samples,
            photo_size: record.evaluator.shrunk,
            dropped: meta.dropped,
            cpu_secs,
            exposure: meta.exposure.details(),
            stopped: end.is_stopped,
            lost: record.lost.into_iter().chain(not_finite).collect(),
        })
    }

    /// Makes the steps until the last, or until the training is stopped.
    fn make_steps(&mut self, record: &mut Recorder<'_>) -> Result<StepsEnd> {
        let total = self.options().steps;
        let sample_every = if self.outputs.sample_every == 0 {
            total.div_ceil(100)
        } else {
            self.outputs.sample_every
        };
        let before = self.steps();
        let mut end = StepsEnd { last_sample: None, is_stopped: false };
        while !self.is_over() && !end.is_stopped {
            match self.make_step(sample_every, record) {
                Ok((sample, is_stopped)) => {
                    end = StepsEnd { last_sample: Some(sample), is_stopped };
                }
                Err(error) => {
                    // A photo that cannot be read loses no step.
                    let written =
                        (self.steps() > before).then(|| self.write_checkpoint(record)).flatten();
                    return Err(with_remedy(error, written));
                }
            }
        }
        Ok(end)
    }

    /// True when no step is left.
    fn is_over(&self) -> bool {
        self.is_done() || self.steps() >= self.until_step
    }

    /// Makes a step and the outputs due after it, with a sample after every `sample_every` steps;
    /// returns its sample, and true to stop.
    fn make_step(
        &mut self,
        sample_every: u64,
        record: &mut Recorder<'_>,
    ) -> Result<(TrainSample, bool)> {
        let (densified, width_px) = self.step()?;
        let step = self.steps();
        let evaluate_every = self.outputs.evaluate_every;
        let is_due = |every: u64| every > 0 && step.is_multiple_of(every);
        let is_kept = is_due(sample_every) || is_due(evaluate_every);
        let mut sample = self.sample(record, width_px, is_kept)?;
        let mut wants_scene = false;
        record.tell(TrainEvent::Step { sample: &sample, wants_scene: &mut wants_scene });
        if let Some(densified) = &densified {
            record.tell(TrainEvent::Densified(sample.step, densified));
        }
        self.correct_pace(record)?;
        let is_over = self.is_over();
        let max_cpu_secs = self.outputs.max_cpu_secs;
        // Of this run: a resumed one has spent some before.
        let spent = sample.cpu_secs - self.meta.cpu_secs;
        let is_spent = max_cpu_secs > 0.0 && spent >= max_cpu_secs;
        let is_stopped = !is_over && (is_spent || record.stop_requested);
        // `Training::final_scores` keeps and evaluates the last sample.
        if !is_over && is_kept {
            let kept = self.keep_sample(record, sample, is_due(evaluate_every))?;
            if !is_stopped {
                record.tell(TrainEvent::Sampled(&kept));
            }
        } else if is_over || is_stopped {
            sample = self.sample(record, width_px, true)?;
        }
        if is_stopped || is_due(self.outputs.checkpoint_every) {
            self.write_checkpoint(record);
        }
        record.preview(step, |evaluator| {
            let soup = self.soup()?;
            Ok(evaluator.first_picture(&soup, &self.space(), &self.drawing()))
        });
        if wants_scene {
            let scene = record.uncounted(|_| self.scene())?;
            record.tell(TrainEvent::Scene(&sample, Box::new(scene)));
        }
        Ok((sample, is_stopped))
    }

    /// The state after a step on a photo of `width_px`, with means since the last kept sample: over
    /// all steps with `all`, else over the steps whose figures have been read.
    fn sample(
        &mut self,
        record: &mut Recorder<'_>,
        width_px: u32,
        all: bool,
    ) -> Result<TrainSample> {
        let figures = self.figures(all || record.needs_figures())?;
        record.add_figures(&figures);
        Ok(TrainSample {
            step: self.steps(),
            triangles: self.triangles() as u64,
            width_px,
            dropped: self.meta.dropped,
            ..record.sample()
        })
    }

    /// Adds a sample to the curve, with the PSNR of the held-out photos if `evaluate`.
    fn keep_sample(
        &mut self,
        record: &mut Recorder<'_>,
        mut sample: TrainSample,
        evaluate: bool,
    ) -> Result<TrainSample> {
        if evaluate {
            let scores =
                record.uncounted(|record| self.scores(&mut record.evaluator, usize::MAX))?;
            sample.test_psnr = Quality::mean(&scores).map(|quality| quality.psnr);
            sample.test_size = sample.test_psnr.and(record.evaluator.shrunk);
        }
        record.reset_means();
        self.meta.curve.push(sample);
        Ok(sample)
    }

    /// Evaluates the present scene, and ends the curve with the `last` sample.
    fn final_scores(
        &mut self,
        record: &mut Recorder<'_>,
        last: Option<TrainSample>,
    ) -> Result<Vec<PhotoScore>> {
        let scores = self.scores(&mut record.evaluator, usize::MAX)?;
        if let Some(last) = last {
            let test_psnr = Quality::mean(&scores).map(|quality| quality.psnr);
            let test_size = test_psnr.and(record.evaluator.shrunk);
            let sample = TrainSample { test_psnr, test_size, ..last };
            self.meta.curve.pop_if(|kept| kept.step == sample.step);
            self.meta.curve.push(sample);
            record.tell(TrainEvent::Sampled(&sample));
        }
        Ok(scores)
    }

    /// Scores of the first `max_photos` held-out photos.
    fn scores(&mut self, evaluator: &mut Evaluator, max_photos: usize) -> Result<Vec<PhotoScore>> {
        if evaluator.views.is_empty() {
            return Ok(Vec::new());
        }
        let drawing = self.drawing();
        if self.draws(&drawing) {
            let draw = |camera: &Camera, drawing: &SoftOptions| self.picture(camera, drawing);
            return evaluator.scores_of(max_photos, &drawing, draw);
        }
        let soup = self.soup()?;
        evaluator.scores(max_photos, &soup, &self.space(), &drawing)
    }

    /// Seconds on the clock of a budget for the evaluation at the end, by that of one photo, which
    /// counts too.
    fn evaluation_secs(&mut self, record: &mut Recorder<'_>, clock: &Spending) -> Result<f64> {
        let before = clock.seconds();
        record.uncounted(|record| self.scores(&mut record.evaluator, 1))?;
        Ok((clock.seconds() - before) * (record.evaluator.views.len() + 1) as f64)
    }

    /// Writes a checkpoint, if the training writes any; returns its step and path.
    fn write_checkpoint(&mut self, record: &mut Recorder<'_>) -> Option<(u64, PathBuf)> {
        if !record.writes_checkpoints() {
            return None;
        }
        let checkpoint = self.checkpoint(record.cpu_secs());
        record.write_checkpoint(checkpoint)
    }

    /// Chooses the remaining steps anew at a milestone.
    fn correct_pace(&mut self, record: &mut Recorder<'_>) -> Result<()> {
        let Some(spending) = self.spending else { return Ok(()) };
        let step = self.steps();
        let triangles = self.triangles() as u64;
        let spent = spending.seconds();
        let is_last = self.options().milestones.last() == Some(&step);
        let reserve = is_last.then(|| self.evaluation_secs(record, &spending)).transpose()?;
        let Some(pace) = &mut self.meta.pace else { return Ok(()) };
        pace.reserve_secs = reserve.or(pace.reserve_secs);
        if let Some(options) = pace.corrected(step, spent, triangles, &self.meta.options) {
            (self.meta.options.steps, self.meta.options.milestones) =
                (options.steps, options.milestones);
            if let Some(correction) = pace.corrections.last() {
                record.tell(TrainEvent::Corrected(correction));
            }
        }
        Ok(())
    }
}

/// The end of the steps.
struct StepsEnd {
    /// The last sample; `None` if no step was made.
    last_sample: Option<TrainSample>,
    is_stopped: bool,
}

/// The error of a run. If a graphics card failed, it says how to continue from the last checkpoint.
fn with_remedy(error: Error, checkpoint: Option<(u64, PathBuf)>) -> Error {
    match (error, checkpoint) {
        (error @ (Error::Gpu(_) | Error::TooLarge { .. }), Some((step, path))) => Error::Card {
            error: Box::new(error),
            remedy: format!(
                "to continue from step {step}: `backend` cpu `resume` {}",
                path.display()
            ),
        },
        (error, _) => error,
    }
}
