//! The observer of a job, from its preparation on.

use crate::error::Result;
use crate::report::{Observer, StageReport};
use crate::train::{TrainObserver, TrainOptions, Trained};

/// Watches a training: its preparation by these methods, its steps as a [`TrainObserver`]. Every method does nothing unless implemented.
pub trait TrainJobObserver: TrainObserver {
    /// A short training is about to begin whose watched photos tell whether the run needs a teacher; returns who watches its steps.
    fn watching_begins(&mut self, _options: &TrainOptions) -> Result<Box<dyn TrainObserver + '_>> {
        Ok(Box::new(()))
    }
    /// What these trainings came to.
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
    /// Teacher `which`, counted from 0, is trained; its file can be written now.
    fn keep_teacher(&mut self, _which: usize, _teacher: &Trained) -> Result<()> {
        Ok(())
    }
    /// `done` of `all` soft pictures are drawn.
    fn drew(&mut self, _done: usize, _all: usize) {}
}

/// Observes nothing.
impl TrainJobObserver for () {}

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
