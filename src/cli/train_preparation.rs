//! The terminal output before the steps of a training: its teacher's run, and drawing pictures.

use super::Global;
use super::outputs::Outputs;
use super::progress::Progress;
use super::signals::Listener;
use super::train_progress::{Bar, Lost};
use std::path::PathBuf;
use trisplat_job::TrainJobObserver;
use trisplat_scene::{
    Error, Result,
    report::{OutputReport, counted},
};
use trisplat_train::{TrainObserver, TrainOptions, Trained};

/// Shows the preparation, and writes the teacher.
pub(super) struct Preparation<'a, 'b> {
    global: &'a Global,
    files: &'a mut Outputs<'b>,
    /// Paths for trained teachers.
    teacher_files: Vec<PathBuf>,
    /// Number of teachers trained so far, by this process or an earlier one.
    teachers: usize,
    /// From the first training on, a request to stop waits for the next step, which saves everything.
    stop: Option<Listener>,
    drawing: Option<Progress>,
    /// Files of the written teachers.
    written: Vec<OutputReport>,
    /// Errors of teachers that could not be written.
    lost_teachers: Vec<Error>,
    /// Checkpoints that could not be written.
    lost: Lost,
}

/// What a preparation leaves.
pub(super) struct Prepared {
    /// Files of the written teachers.
    pub(super) teachers: Vec<OutputReport>,
    /// Errors of teachers that could not be written.
    pub(super) lost_teachers: Vec<Error>,
    /// Checkpoints that could not be written.
    pub(super) lost: Lost,
    /// The listener, if anything was trained.
    pub(super) stop: Option<Listener>,
}

impl<'a, 'b> Preparation<'a, 'b> {
    pub(super) fn new(global: &'a Global, files: &'a mut Outputs<'b>, teacher_files: Vec<PathBuf>) -> Self {
        let (written, lost_teachers, lost) = (Vec::new(), Vec::new(), Lost::default());
        Self {
            global,
            files,
            teacher_files,
            teachers: 0,
            stop: None,
            drawing: None,
            written,
            lost_teachers,
            lost,
        }
    }

    /// Claims the files of teachers that are trained by default.
    pub(super) fn claim_teachers(&mut self) -> Result<()> {
        self.teacher_files.iter().try_for_each(|path| self.files.claim("--teacher", path))
    }

    /// Removes the bar, and older files beside those of the written teachers.
    pub(super) fn done(self) -> Prepared {
        self.drawing.iter().for_each(Progress::done);
        if !self.written.is_empty() && self.lost_teachers.is_empty() {
            // A later reading as this run's teachers would change the result; files that cannot be removed
            // stay.
            self.teacher_files.iter().skip(self.teachers).for_each(|old| drop(std::fs::remove_file(old)));
        }
        let Self { written: teachers, lost_teachers, lost, stop, .. } = self;
        Prepared { teachers, lost_teachers, lost, stop }
    }
}

impl TrainJobObserver for Preparation<'_, '_> {
    fn watching_begins(&mut self, options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        self.stop.get_or_insert_with(Listener::new);
        let bar = Bar::of_watching(self.global, options, " (--teacher off skips it)")?;
        Ok(Box::new(bar.losing_to(&self.lost)))
    }

    fn watched(&mut self, summary: &str) {
        // Without a bar nothing can fail.
        Bar::new(self.global, 0, 0, None, &[]).iter_mut().for_each(|bar| bar.line(summary));
    }

    fn teacher_begins(&mut self, options: &TrainOptions, asked: bool) -> Result<Box<dyn TrainObserver + '_>> {
        self.stop.get_or_insert_with(Listener::new);
        let bar = Bar::new(self.global, options.steps, 0, None, &[])?;
        let by_default = if asked { "" } else { " (--teacher off skips it)" };
        let steps = counted(options.steps, "step");
        bar.line(&match self.written.len() + self.lost_teachers.len() {
            0 => format!("a soft teacher scene is trained first: {steps}{by_default}"),
            trained => format!("teacher {} is trained: {steps}", trained + 1),
        });
        Ok(Box::new(bar.losing_to(&self.lost)))
    }

    fn keep_teacher(&mut self, which: usize, teacher: &Trained) -> Result<()> {
        self.teachers = which + 1;
        let path = &self.teacher_files[which];
        match self.files.take(path).and_then(|file| teacher.save_to(file)) {
            Ok(bytes) => self.written.push(OutputReport { path: path.display().to_string(), bytes }),
            // The run has the scene in memory, and a resumed run trains it again.
            Err(error) => self.lost_teachers.push(error),
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
