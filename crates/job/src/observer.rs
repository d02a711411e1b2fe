//! Observers of jobs, from preparation to end.

use std::path::PathBuf;
use trisplat_capture::CaptureObserver;
use trisplat_scene::{
    Result,
    report::{Observer, StageReport},
};
use trisplat_train::{TrainObserver, TrainOptions, Trained};

/// Observes a training job: these methods for its preparation, [`TrainObserver`] for its steps. By default every method does nothing.
pub trait TrainJobObserver: TrainObserver {
    /// A short training with watched photos begins; returns the observer of its steps.
    fn watching_begins(&mut self, _options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        Ok(Box::new(()))
    }
    /// The result of the short trainings.
    fn watched(&mut self, _summary: &str) {}
    /// A teacher is about to be trained, as `options` say; returns who watches its steps. `asked`: it was asked for, and does not come by
    /// default.
    fn teacher_begins(
        &mut self,
        _options: &TrainOptions,
        _asked: bool,
    ) -> Result<Box<dyn TrainObserver + '_>> {
        Ok(Box::new(()))
    }
    /// Teacher `which`, counted from 0, is trained: time to write its file.
    fn keep_teacher(&mut self, _which: usize, _teacher: &Trained) -> Result<()> {
        Ok(())
    }
    /// `done` of `all` soft pictures are drawn.
    fn drew(&mut self, _done: usize, _all: usize) {}
    /// The preparation is over, and the run begins: `done` of `steps` steps were made by earlier ones.
    fn training_begins(&mut self, _begins: &TrainBegins) -> Result<()> {
        Ok(())
    }
}

/// A run that is about to begin.
#[derive(Debug, Clone, Default)]
pub struct TrainBegins {
    /// Steps in all.
    pub steps: u64,
    /// Steps that were made before.
    pub done: u64,
    /// What its budget was planned for, as said to people.
    pub plan: Option<String>,
    /// The graphics card it is on.
    pub card: Option<String>,
}

/// Observes nothing.
impl TrainJobObserver for () {}

/// Watches everything that is made of photos, each part by an observer of its own.
pub trait MakeJobObserver {
    /// Photos and poses.
    fn captures(&mut self) -> Box<dyn CaptureObserver + '_>;
    /// The training. Its teachers, if it has any, are kept under these names.
    fn trains(&mut self, teacher_files: &[PathBuf]) -> Result<Box<dyn TrainJobObserver + '_>>;
    /// The files.
    fn bakes(&mut self) -> Box<dyn BakeJobObserver + '_>;
    /// Whether to stop between two parts.
    fn wants_to_stop(&mut self) -> bool {
        false
    }
    /// A stage is over that has no observer of its own, or was not needed.
    fn finished(&mut self, _stage: &StageReport) {}
}

/// Watches a bake: its preparation by these methods, its stages as an [`Observer`]. Every method does nothing unless implemented.
pub trait BakeJobObserver: Observer {
    /// The scene is about to be trained solid, as `options` say; returns who watches the steps.
    fn hardening_begins(&mut self, _options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        Ok(Box::new(()))
    }
    /// `done` of `all` soft pictures are drawn.
    fn drew(&mut self, _done: usize, _all: usize) {}
    /// The scene is about to be baked with at most `triangles`, which are expected to fit `limit` bytes; not at all of a bake without a limit.
    fn fits(&mut self, _limit: u64, _triangles: Option<u64>) {}
    /// The preparation is over; these were its stages.
    fn prepared(&mut self, _stages: &[StageReport]) {}
}

/// Observes nothing.
impl BakeJobObserver for () {}
