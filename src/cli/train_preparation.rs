//! The terminal output before the steps of a training: its teacher's run, and drawing pictures.

use super::Global;
use super::outputs::Outputs;
use super::progress::Progress;
use super::train_progress::Bar;
use std::path::PathBuf;
use trisplat_job::TrainJobObserver;
use trisplat_scene::error::{Error, Result};
use trisplat_scene::report::{OutputReport, counted};
use trisplat_train::{TrainObserver, TrainOptions, Trained};

/// Shows the preparation, and writes the teacher.
pub(super) struct Preparation<'a, 'b> {
    global: &'a Global,
    files: &'a mut Outputs<'b>,
    /// Path for trained teachers.
    teacher_files: Vec<PathBuf>,
    drawing: Option<Progress>,
    /// Files of the written teachers.
    written: Vec<OutputReport>,
    /// Errors of teachers that could not be written.
    lost: Vec<Error>,
}

impl<'a, 'b> Preparation<'a, 'b> {
    pub(super) fn new(global: &'a Global, files: &'a mut Outputs<'b>, teacher_files: Vec<PathBuf>) -> Self {
        Self { global, files, teacher_files, drawing: None, written: vec![], lost: vec![] }
    }

    /// Removes the bar; returns the files of the written teachers, and the errors of others. Older files
    /// beside them are removed.
    pub(super) fn done(self) -> (Vec<OutputReport>, Vec<Error>) {
        self.drawing.iter().for_each(Progress::done);
        if !self.written.is_empty() && self.lost.is_empty() {
            // A later reading as this run's teachers would change the result; files that cannot be removed
            // stay.
            self.teacher_files
                .iter()
                .skip(self.written.len())
                .for_each(|old| drop(std::fs::remove_file(old)));
        }
        (self.written, self.lost)
    }
}

impl TrainJobObserver for Preparation<'_, '_> {
    fn watching_begins(&mut self, options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        let bar = Bar::new(self.global, options.steps, 0, None, &[])?;
        let steps = counted(options.steps, "step");
        bar.line(&format!(
            "a short training leaves some photos out, to see what more steps gain: {steps} (--teacher off skips it)"
        ));
        Ok(Box::new(bar))
    }

    fn watched(&mut self, summary: &str) {
        // Without a bar nothing can fail.
        Bar::new(self.global, 0, 0, None, &[]).iter_mut().for_each(|bar| bar.line(summary));
    }

    fn teacher_begins(&mut self, options: &TrainOptions, asked: bool) -> Result<Box<dyn TrainObserver + '_>> {
        let bar = Bar::new(self.global, options.steps, 0, None, &[])?;
        let by_default = if asked { "" } else { " (--teacher off skips it)" };
        let steps = counted(options.steps, "step");
        bar.line(&match self.written.len() + self.lost.len() {
            0 => format!("a soft teacher scene is trained first: {steps}{by_default}"),
            trained => format!("teacher {} is trained: {steps}", trained + 1),
        });
        Ok(Box::new(bar))
    }

    fn keep_teacher(&mut self, which: usize, teacher: &Trained) -> Result<()> {
        let path = &self.teacher_files[which];
        match self.files.take(path).and_then(|file| teacher.save_to(file)) {
            Ok(bytes) => self.written.push(OutputReport { path: path.display().to_string(), bytes }),
            // The run has the scene in memory, and a resumed run trains it again.
            Err(error) => self.lost.push(error),
        }
        Ok(())
    }

    fn drew(&mut self, done: usize, all: usize) {
        let progress = self.drawing.get_or_insert_with(|| Progress::new(self.global));
        progress.note(&format!("drawing soft pictures: {done} of {all}"));
    }
}

/// The steps of the run itself have a bar of their own.
impl TrainObserver for Preparation<'_, '_> {}
