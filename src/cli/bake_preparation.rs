//! The terminal output of a bake: hardening, drawing pictures, stages.

use super::Global;
use super::progress::{Progress, thousands};
use super::train_progress::Bar;
use clap::Command;
use trisplat_job::BakeJobObserver;
use trisplat_scene::{
    Result,
    report::{Observer, StageReport},
};
use trisplat_train::{TrainObserver, TrainOptions};

/// Shows a bake.
pub(super) struct Terminal<'a> {
    global: &'a Global,
    command: Command,
    drawing: Option<Progress>,
    stages: Option<Progress>,
}

impl<'a> Terminal<'a> {
    /// Spells the fields named in reasons and warnings as the flags of `command`.
    pub(super) fn new(global: &'a Global, command: Command) -> Self {
        Self { global, command, drawing: None, stages: None }
    }

    /// Removes the bar; returns the printer of lines.
    pub(super) fn done(mut self) -> Progress {
        let progress = self.stages.take().unwrap_or_else(|| Progress::new(self.global));
        progress.done();
        progress
    }

    /// Takes the bar away.
    pub(super) fn clear(&self) {
        self.drawing.iter().chain(&self.stages).for_each(Progress::done);
    }

    fn stages(&mut self) -> &mut Progress {
        let (global, command) = (self.global, &self.command);
        self.stages.get_or_insert_with(|| Progress::new(global).with_flags_of(command.clone()))
    }
}

impl BakeJobObserver for Terminal<'_> {
    fn hardening_begins(&mut self, options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        self.drawing.take().iter().for_each(Progress::done);
        Ok(Box::new(Bar::new(self.global, options.steps, 0, None, &[])?))
    }

    fn drew(&mut self, done: usize, all: usize) {
        let progress = self.drawing.get_or_insert_with(|| Progress::new(self.global));
        progress.note(&format!("drawing soft pictures: {done} of {all}"));
    }

    fn fits(&mut self, limit: u64, triangles: Option<u64>) {
        let which =
            triangles.map_or("all triangles".to_owned(), |most| format!("{} triangles", thousands(most)));
        self.stages().line(&format!("baking {which} into {} bytes", thousands(limit)));
    }

    fn prepared(&mut self, stages: &[StageReport]) {
        let progress = self.stages();
        stages.iter().for_each(|stage| progress.finished(stage));
    }
}

impl Observer for Terminal<'_> {
    fn started(&mut self, name: &str) {
        self.stages().started(name);
    }

    fn progressed(&mut self, fraction: f64) {
        self.stages().progressed(fraction);
    }

    fn finished(&mut self, stage: &StageReport) {
        self.stages().finished(stage);
    }
}
