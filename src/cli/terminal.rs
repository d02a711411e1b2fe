//! Terminal output of a job: trainings, drawings, stages.

use super::GlobalArgs;
use super::messages::thousands;
use super::progress::Progress;
use super::signals::{self, Listener};
use super::train_progress::TrainProgress;
use clap::Command;
use std::ops::ControlFlow;
use std::path::Path;
use trisplat_dataset::exposure::ExposureEvidence;
use trisplat_job::{Event, MakePart, TrainBegins, TrainPart};
use trisplat_scene::Result;
use trisplat_scene::report::counted;

/// Shows a job, and stops it where a request to stop does not lose work: in captures and trainings.
pub(super) struct Terminal<'a> {
    global: &'a GlobalArgs,
    command: Command,
    /// While it is there, a request to stop waits for the next event; otherwise it ends the
    /// program.
    stop: Option<Listener>,
    captures: bool,
    /// Teachers that have begun.
    teachers: usize,
    trials: usize,
    drawing: Option<Progress>,
    stages: Option<Progress>,
    /// The bar of the last training.
    pub(super) bar: Option<TrainProgress>,
}

impl<'a> Terminal<'a> {
    /// Spells the fields named in reasons and warnings as the flags of `command`.
    pub(super) fn new(global: &'a GlobalArgs, command: Command) -> Self {
        let drawing = None;
        let stages = None;
        let bar = None;
        Self {
            global,
            command,
            stop: None,
            captures: false,
            teachers: 0,
            trials: 0,
            drawing,
            stages,
            bar,
        }
    }

    /// Shows an event; `Break` after a request to stop, where nothing is lost.
    pub(super) fn tell(&mut self, event: Event<'_>) -> ControlFlow<()> {
        match event {
            Event::Part(part) => {
                let told = self.flow();
                self.begin_part(part);
                return told;
            }
            Event::StageStarted(_)
            | Event::StageProgress(_)
            | Event::StageNote(_)
            | Event::StageWaiting
            | Event::StageFinished(_) => return self.tell_stage(event),
            // Without a log nothing can fail.
            Event::TrainingStarted(begins) => drop(self.begin(begins, None)),
            Event::Step { .. }
            | Event::CurveSample(_)
            | Event::Densified(..)
            | Event::StepsReplanned(_)
            | Event::WriteFailed(_)
            | Event::SceneCopy(..) => {
                if let Some(bar) = &mut self.bar {
                    return bar.show(event);
                }
            }
            Event::Exposure(evidence) => self.line(&exposure(evidence)),
            Event::Teacher(_) => {}
            Event::PicturesDrawn { done, all } => {
                let progress = self.drawing.get_or_insert_with(|| {
                    let mut progress = Progress::new(self.global);
                    progress.show_start("drawing");
                    progress
                });
                progress.show_progress(done as f64 / all.max(1) as f64);
                progress.note(&format!("drawing soft pictures: {done} of {all}"));
            }
            Event::SizeLimit { limit, triangles } => {
                let all = || "all triangles".to_owned();
                let which =
                    triangles.map_or_else(all, |most| format!("{} triangles", thousands(most)));
                self.stages().line(&format!("baking {which} into {} bytes", thousands(limit)));
            }
        }
        // A stop before the first step of a training would lose it.
        ControlFlow::Continue(())
    }

    /// Shows an event of a stage. Only a capture is stopped.
    pub(super) fn tell_stage(&mut self, event: Event<'_>) -> ControlFlow<()> {
        self.drawing = None;
        if !self.captures {
            self.bar = None;
            self.stop = None;
        }
        self.stages().tell(event);
        self.flow()
    }

    pub(super) fn begin_part(&mut self, part: MakePart) {
        self.clear();
        self.captures = part == MakePart::Capture;
        self.stop = self.captures.then(Listener::new);
    }

    /// Shows a training that begins; its log goes to a file.
    ///
    /// # Errors
    ///
    /// The log cannot be opened.
    pub(super) fn begin(&mut self, begins: &TrainBegins<'_>, log: Option<&Path>) -> Result<()> {
        self.stop.get_or_insert_with(Listener::new);
        let lost = self.bar.take().map_or_else(Vec::new, |mut bar| bar.finish());
        self.clear();
        let TrainBegins { part, steps, done, .. } = *begins;
        let mut bar = TrainProgress::new(self.global, steps, done, log, begins.curve)?;
        bar.lost = lost;
        let count = counted(steps, "step");
        match part {
            TrainPart::Trial => {
                self.trials += 1;
                if self.trials == 1 {
                    bar.line(&format!(
                        "trial run on a validation split, which decides the correction of exposures: {count}"
                    ));
                }
            }
            TrainPart::Teacher => {
                self.teachers += 1;
                bar.line(&match self.teachers {
                    1 => format!("a soft teacher scene is trained first: {count}"),
                    which => format!("teacher {which} is trained: {count}"),
                });
            }
            TrainPart::Scene => {
                bar.announce(begins.card.as_deref(), []);
                if begins.card.is_some() {
                    bar.rate_from = Some(done);
                }
                match &begins.plan {
                    Some(plan) => bar.line(plan),
                    // A part of a bake.
                    None if begins.photos.is_none() => {
                        bar.line(&format!("solid triangles are trained: {count}"));
                    }
                    None => {}
                }
                if done > 0 {
                    bar.line(&format!("the training goes on after {done} of {steps} steps"));
                }
            }
        }
        self.bar = Some(bar);
        Ok(())
    }

    /// `Break` after a request to stop that waits for it.
    fn flow(&self) -> ControlFlow<()> {
        if self.stop.is_some() && signals::exit_code().is_some() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    /// Prints a line.
    pub(super) fn line(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.line(text),
            None => Progress::new(self.global).line(text),
        }
    }

    /// Removes the bar; returns the printer of lines.
    pub(super) fn done(mut self) -> Progress {
        self.stages().done();
        let progress = self.stages.take();
        progress.unwrap_or_else(|| Progress::new(self.global))
    }

    fn clear(&mut self) {
        self.drawing = None;
        self.stages = None;
        self.bar = None;
    }

    fn stages(&mut self) -> &mut Progress {
        let global = self.global;
        let command = &self.command;
        self.stages.get_or_insert_with(|| Progress::new(global).with_flags_of(command.clone()))
    }
}

/// Evidence of left-out photos for the estimated exposures.
fn exposure(evidence: &ExposureEvidence) -> String {
    let ExposureEvidence { photos, slopes, strengths } = evidence;
    let percent = |share: f32| format!("{:.0}%", 100.0 * share);
    let [gain, balance, falloff] = slopes.to_array().map(percent);
    let shown = format!(
        "{} left out show {gain} of their estimated exposure, {balance} of their white balance and {falloff} of the falloff",
        counted(*photos, "photo")
    );
    let [gain, balance, falloff] = strengths.to_array().map(percent);
    if strengths.is_none() {
        format!("{shown}: photos are taken as they are (`train --set exposure=on` corrects them)")
    } else {
        format!(
            "{shown}: {gain}, {balance} and {falloff} are corrected (`train --set exposure=off` takes photos as they are)"
        )
    }
}
