//! The events of a job, for a program that shows it and may stop it.

use std::ops::ControlFlow;
use trisplat_dataset::Dataset;
use trisplat_dataset::exposure::ExposureEvidence;
use trisplat_scene::report::{Report, StageEvent, StageReport, counted};
use trisplat_scene::{Error, ImportedScene, Result};
use trisplat_train::budget::Correction;
use trisplat_train::{Densified, TrainEvent, TrainSample, Trained};

/// The part of a training that a step belongs to.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum TrainPart {
    /// A short training on some of the photos; the others decide the correction of exposures.
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

/// The start of a training. Only the training of the scene has warnings, stages, a plan and a card.
#[derive(Debug, Clone, Default)]
pub struct TrainBegins<'a> {
    /// Part of the training.
    pub part: TrainPart,
    /// Steps in all.
    pub steps: u64,
    /// Steps that were made before.
    pub done: u64,
    /// Plan of its budget, a sentence for people.
    pub plan: Option<String>,
    /// Graphics card.
    pub card: Option<String>,
    /// Photos that are trained on or held out.
    pub photos: Option<&'a Dataset>,
    /// The curve before it was resumed.
    pub curve: &'a [TrainSample],
    /// Earlier stages.
    pub stages: &'a [StageReport],
    /// Notes for the user.
    pub warnings: &'a [String],
}

/// An event of a job.
#[derive(Debug)]
pub enum Event<'a> {
    /// A part of a [`MakeJob`](super::MakeJob) begins; `ControlFlow::Break` stops the job before
    /// it.
    Part(MakePart),
    /// A stage starts.
    StageStarted(&'a str),
    /// Progress of the running stage, a fraction from 0 to 1; only of stages that may take long.
    StageProgress(f64),
    /// Status text of the running stage.
    StageNote(&'a str),
    /// A chance to stop the running stage.
    StageWaiting,
    /// A stage ended.
    StageFinished(&'a StageReport),
    /// A training begins; `ControlFlow::Break` stops the job before it, without a checkpoint.
    TrainingStarted(&'a TrainBegins<'a>),
    /// A training made a step.
    Step {
        /// Part of the training.
        part: TrainPart,
        /// Loss and PSNR are means over the steps since the last sample with known figures; on a
        /// graphics card the last two steps are not known yet.
        sample: &'a TrainSample,
        /// Set it to get [`Event::SceneCopy`] after this step.
        wants_scene: &'a mut bool,
    },
    /// A sample of the training curve; its loss and PSNR are means since the last one.
    CurveSample(&'a TrainSample),
    /// The scene was densified after this step.
    Densified(u64, &'a Densified),
    /// The budget changed the planned number of steps.
    StepsReplanned(&'a Correction),
    /// A checkpoint or a preview could not be written; the training continues.
    WriteFailed(&'a Error),
    /// A copy of the scene after the step of the sample, as in its file.
    SceneCopy(&'a TrainSample, Box<ImportedScene>),
    /// The evidence of left-out photos for the correction of exposures.
    Exposure(&'a ExposureEvidence),
    /// The teacher is trained: time to write its file.
    Teacher(&'a Trained),
    /// Soft pictures are drawn.
    PicturesDrawn {
        /// Pictures drawn.
        done: usize,
        /// Pictures in all.
        all: usize,
    },
    /// A bake with at most `triangles` begins, which are expected to fit `limit` bytes. Only
    /// emitted when a byte limit is set.
    SizeLimit {
        /// Bytes.
        limit: u64,
        /// `None`: all.
        triangles: Option<u64>,
    },
}

impl<'a> From<StageEvent<'a>> for Event<'a> {
    fn from(event: StageEvent<'a>) -> Self {
        match event {
            StageEvent::Started(name) => Self::StageStarted(name),
            StageEvent::Progressed(fraction) => Self::StageProgress(fraction),
            StageEvent::Noted(text) => Self::StageNote(text),
            StageEvent::Waiting => Self::StageWaiting,
            StageEvent::Finished(stage) => Self::StageFinished(stage),
        }
    }
}

impl<'a> Event<'a> {
    /// An event of the training of `part`.
    pub fn of_training(part: TrainPart, event: TrainEvent<'a>) -> Self {
        match event {
            TrainEvent::Step { sample, wants_scene } => Self::Step { part, sample, wants_scene },
            TrainEvent::Sampled(sample) => Self::CurveSample(sample),
            TrainEvent::Densified(step, densified) => Self::Densified(step, densified),
            TrainEvent::Corrected(correction) => Self::StepsReplanned(correction),
            TrainEvent::Lost(error) => Self::WriteFailed(error),
            TrainEvent::Scene(sample, scene) => Self::SceneCopy(sample, scene),
        }
    }
}

/// Receives events; `ControlFlow::Break` asks the job to stop: a training after its step,
/// everything else before its next stage.
pub type Observer<'a> = &'a mut dyn FnMut(Event<'_>) -> ControlFlow<()>;

/// Announces a training; returns the observer of its steps.
///
/// # Errors
///
/// The observer stops it before it begins.
pub(super) fn begin<'a>(
    observer: Observer<'a>,
    begins: &TrainBegins<'_>,
) -> Result<impl FnMut(TrainEvent<'_>) -> ControlFlow<()> + use<'a>> {
    let part = begins.part;
    match observer(Event::TrainingStarted(begins)) {
        ControlFlow::Continue(()) => {
            Ok(move |event: TrainEvent<'_>| observer(Event::of_training(part, event)))
        }
        ControlFlow::Break(()) => {
            let what = "stopped before a training began; nothing was written".to_owned();
            Err(Error::Stopped { what })
        }
    }
}

/// Adds a stage to `report` and announces its end.
pub(super) fn add(stage: StageReport, report: &mut Report, observer: Observer<'_>) {
    // A `Break` is obeyed at the next stage.
    let _ = observer(Event::StageFinished(&stage));
    report.stages.push(stage);
}

/// The observer of stages.
pub(super) fn stages(observer: Observer<'_>) -> impl FnMut(StageEvent<'_>) -> ControlFlow<()> {
    |event| observer(event.into())
}

/// The observer of drawings. No drawing is stopped: the training after it is.
pub(super) fn on_drawn(observer: Observer<'_>) -> impl FnMut(usize, usize) {
    |done, all| {
        let _ = observer(Event::PicturesDrawn { done, all });
    }
}

/// The error of a run that was stopped in `what`, one of its trainings.
pub(super) fn stopped_error(what: &str, training: &Trained) -> Error {
    let steps = counted(training.options.steps, "step");
    let place = format!("stopped in {what}, after {} of {steps}", training.steps);
    Error::Stopped {
        what: format!("{place}; nothing was written, and the same command begins again"),
    }
}
