//! What the terminal shows of a training that is a part of another command.

use super::Global;
use super::progress::Progress;
use super::signals::Listener;
use super::train_progress::Bar;
use std::path::PathBuf;
use trisplat_job::{TrainBegins, TrainJobObserver};
use trisplat_scene::{Error, Result, report::counted};
use trisplat_train::{Densified, TrainObserver, TrainOptions, TrainSample, Trained, budget::Correction};

/// Shows a training: its preparation, then its steps.
pub(super) struct TrainTerminal<'a> {
    global: &'a Global,
    teacher_files: Vec<PathBuf>,
    /// From the first training on, a request to stop waits for the next step, which saves everything.
    stop: Option<Listener>,
    bar: Option<Bar>,
    drawing: Option<Progress>,
}

impl<'a> TrainTerminal<'a> {
    /// Keeps teachers in these files; without files, none.
    pub(super) fn new(global: &'a Global, teacher_files: Vec<PathBuf>) -> Self {
        Self { global, teacher_files, stop: None, bar: None, drawing: None }
    }
}

impl TrainJobObserver for TrainTerminal<'_> {
    fn watching_begins(&mut self, options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        self.stop.get_or_insert_with(Listener::new);
        Ok(Box::new(Bar::of_watching(self.global, options, "")?))
    }

    fn watched(&mut self, summary: &str) {
        Progress::new(self.global).line(summary);
    }

    fn teacher_begins(
        &mut self,
        options: &TrainOptions,
        _asked: bool,
    ) -> Result<Box<dyn TrainObserver + '_>> {
        self.stop.get_or_insert_with(Listener::new);
        let bar = Bar::new(self.global, options.steps, 0, None, &[])?;
        bar.line(&format!("a soft teacher scene is trained first: {}", counted(options.steps, "step")));
        Ok(Box::new(bar))
    }

    fn keep_teacher(&mut self, which: usize, teacher: &Trained) -> Result<()> {
        let Some((path, later)) = self.teacher_files.get(which..).and_then(<[PathBuf]>::split_first) else {
            return Ok(());
        };
        // A resumed run would take those of an earlier run for its own.
        later.iter().for_each(|old| drop(std::fs::remove_file(old)));
        teacher.save(path).map(drop)
    }

    fn drew(&mut self, done: usize, all: usize) {
        let progress = self.drawing.get_or_insert_with(|| Progress::new(self.global));
        progress.note(&format!("drawing soft pictures: {done} of {all}"));
    }

    fn training_begins(&mut self, begins: &TrainBegins) -> Result<()> {
        self.drawing.take().iter().for_each(Progress::done);
        let mut bar = Bar::new(self.global, begins.steps, begins.done, None, &[])?;
        if let Some(card) = &begins.card {
            bar.line(&format!("training on {card}"));
            bar.say_rate(begins.done);
        }
        begins.plan.iter().for_each(|plan| bar.line(plan));
        if begins.done > 0 {
            bar.line(&format!("the training goes on after {} of {} steps", begins.done, begins.steps));
        }
        self.bar = Some(bar);
        Ok(())
    }
}

impl TrainObserver for TrainTerminal<'_> {
    fn stepped(&mut self, sample: &TrainSample) {
        self.bar.iter_mut().for_each(|bar| bar.stepped(sample));
    }

    fn sampled(&mut self, sample: &TrainSample) {
        self.bar.iter_mut().for_each(|bar| bar.sampled(sample));
    }

    fn densified(&mut self, step: u64, densified: &Densified) {
        self.bar.iter_mut().for_each(|bar| bar.densified(step, densified));
    }

    fn corrected(&mut self, correction: &Correction) {
        self.bar.iter_mut().for_each(|bar| bar.corrected(correction));
    }

    fn lost(&mut self, error: &Error) {
        self.bar.iter_mut().for_each(|bar| TrainObserver::lost(bar, error));
    }

    fn wants_to_stop(&mut self) -> bool {
        self.bar.as_mut().is_some_and(TrainObserver::wants_to_stop)
    }
}
