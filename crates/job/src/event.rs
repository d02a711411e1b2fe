//! One stream of events for a program that shows a job and may stop it.

use std::ops::ControlFlow;
use trisplat_dataset::Dataset;
use trisplat_dataset::exposure::ExposureEvidence;
use trisplat_scene::report::{Report, StageEvent, StageReport, counted};
use trisplat_scene::{Error, Result};
use trisplat_train::{TrainEvent, TrainSample, Trained};

/// The part of a training that a step belongs to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TrainPart {
    /// A short training on some of the photos; the others show how far exposures are corrected.
    Trial,
    /// A soft scene whose pictures the scene is trained on too.
    Teacher,
    /// The scene.
    #[default]
    Scene,
}

/// The part of a [`MakeJob`](super::MakeJob).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MakePart {
    /// Photos and poses.
    Capture,
    /// The training.
    Train,
    /// The files.
    Bake,
    /// The file of the subject alone.
    Subject,
}

/// A training that is about to begin. Only that of the scene has warnings, stages, a plan and a
/// card.
#[derive(Debug, Clone, Default)]
pub struct TrainBegins<'a> {
    /// The part that it is.
    pub part: TrainPart,
    /// Steps in all.
    pub steps: u64,
    /// Steps that were made before.
    pub done: u64,
    /// What its budget was planned for, as said to people.
    pub plan: Option<String>,
    /// The graphics card it is on.
    pub card: Option<String>,
    /// Photos that are trained on or held out.
    pub photos: Option<&'a Dataset>,
    /// The curve before it was resumed.
    pub curve: &'a [TrainSample],
    /// What came before it.
    pub stages: &'a [StageReport],
    /// Notes for the user.
    pub warnings: &'a [String],
}

/// What happens in a job.
#[derive(Debug)]
pub enum Event<'a> {
    /// A part of a [`MakeJob`](super::MakeJob) begins; `ControlFlow::Break` stops the job before
    /// it.
    Part(MakePart),
    /// In a stage.
    Stage(StageEvent<'a>),
    /// A training begins; `ControlFlow::Break` stops the job before it, without a checkpoint.
    Begins(&'a TrainBegins<'a>),
    /// In a training.
    Train(TrainPart, TrainEvent<'a>),
    /// What photos showed that short trainings left out.
    Exposure(&'a ExposureEvidence),
    /// The teacher is trained: time to write its file.
    Teacher(&'a Trained),
    /// Soft pictures are drawn.
    Drew {
        /// Pictures drawn.
        done: usize,
        /// Pictures in all.
        all: usize,
    },
    /// The scene is about to be baked with at most `triangles`, which are expected to fit `limit`
    /// bytes; not at all of a bake without a limit.
    Fits {
        /// Bytes.
        limit: u64,
        /// `None`: all.
        triangles: Option<u64>,
    },
}

/// Is told what happens; `ControlFlow::Break` asks the job to stop: a training after its step,
/// everything else before its next stage.
pub type Observer<'a> = &'a mut dyn FnMut(Event<'_>) -> ControlFlow<()>;

/// Tells that a training begins; returns the observer of its steps.
///
/// # Errors
///
/// It is stopped before it begins.
pub(super) fn begin<'a>(
    observer: Observer<'a>,
    begins: &TrainBegins<'_>,
) -> Result<impl FnMut(TrainEvent<'_>) -> ControlFlow<()> + use<'a>> {
    let part = begins.part;
    match observer(Event::Begins(begins)) {
        ControlFlow::Continue(()) => {
            Ok(move |event: TrainEvent<'_>| observer(Event::Train(part, event)))
        }
        ControlFlow::Break(()) => {
            let what = "stopped before a training began; nothing was written".to_owned();
            Err(Error::Stopped { what })
        }
    }
}

/// Adds a stage to `report`, and tells of its end.
pub(super) fn add(stage: StageReport, report: &mut Report, observer: Observer<'_>) {
    // The next stage asks whether to go on.
    let _ = observer(Event::Stage(StageEvent::Finished(&stage)));
    report.stages.push(stage);
}

/// The observer of stages.
pub(super) fn stages(observer: Observer<'_>) -> impl FnMut(StageEvent<'_>) -> ControlFlow<()> {
    |event| observer(Event::Stage(event))
}

/// The observer of drawings. No drawing is stopped: the training after it is.
pub(super) fn on_drawn(observer: Observer<'_>) -> impl FnMut(usize, usize) {
    |done, all| {
        let _ = observer(Event::Drew { done, all });
    }
}

/// The error of a run that was stopped in `what`, a training that it needs.
pub(super) fn stopped(what: &str, training: &Trained) -> Error {
    let steps = counted(training.options.steps, "step");
    let place = format!("stopped in {what}, after {} of {steps}", training.steps);
    Error::Stopped {
        what: format!("{place}; nothing was written, and the same command begins again"),
    }
}
