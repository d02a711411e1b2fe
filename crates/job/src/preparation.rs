//! A run that is stopped before its own first step, in a training that its preparation needs. The checkpoint of that training holds
//! the run too, so `resume` continues there, and the run ends as if it had not been stopped.

use super::watched::{TrialRun, WatchedTraining};
use serde::{Deserialize, Serialize};
use trisplat_scene::{Budget, Error, Result, Spending, layered::Layered, report::counted};
use trisplat_train::{Checkpoint, PreparedRun, RunOptions, TrainOptions, TrainRun, Trained};

/// A run in its preparation: everything that decides how it goes on, apart from photos.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Preparation {
    /// Options of the run, and the layer of each.
    pub(super) options: Layered<TrainOptions>,
    pub(super) budget: Option<Budget>,
    /// The limit of CPU seconds that it began with.
    pub(super) max_cpu_secs: f64,
    /// Whether a teacher was requested.
    pub(super) asked: bool,
    /// The requested share of its pictures.
    pub(super) teacher_share: Option<f64>,
    /// The part under way.
    pub(super) part: PreparationPart,
}

/// A part of the preparation.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub(super) enum PreparationPart {
    /// Short trainings; the results of finished ones, in their order.
    Watching(Vec<WatchedTraining>),
    /// The training of the teacher.
    Teacher {
        /// Result of the short trainings, if there were any.
        watched: Option<TrialRun>,
        /// The size of photos that the budget chose for it.
        max_size: Option<u32>,
    },
}

/// A preparation that goes on.
#[derive(Debug, Clone)]
pub(super) struct Resumed {
    pub(super) part: PreparationPart,
    /// The training that was stopped, until it is resumed.
    pub(super) checkpoint: Option<Checkpoint>,
    /// Seconds of the budget that earlier processes spent.
    pub(super) spent_secs: f64,
    /// The limit of CPU seconds that the run began with.
    pub(super) max_cpu_secs: f64,
}

/// The preparation in a checkpoint.
///
/// Errors: that of another version of this program.
pub(super) fn unpack(prepared: PreparedRun) -> Result<(Preparation, f64)> {
    let other = |error: serde_json::Error| {
        Error::invalid(
            "resume",
            format!("of a run with other options: {error}"),
            "a checkpoint of this version",
        )
    };
    let run: Preparation = serde_json::from_value(prepared.state).map_err(other)?;
    run.options.options.validate()?;
    Ok((run, prepared.spent_secs))
}

/// Where and how trainings of a preparation are stored.
pub(super) struct Storing {
    /// The checkpoints of the run, and its limit.
    pub(super) outputs: RunOptions,
    /// Whether a resumed training may differ in its inputs.
    pub(super) force_resume: bool,
    /// The clock of the budget.
    pub(super) spending: Spending,
    /// The run; each training has a part of its own.
    pub(super) run: Preparation,
}

impl Storing {
    /// `training` with checkpoints that hold the run, which is in this `part`; resumed, if it was stopped.
    pub(super) fn stored<'a>(
        &self,
        training: TrainRun<'a>,
        part: PreparationPart,
        resume: Option<Checkpoint>,
    ) -> Result<TrainRun<'a>> {
        let run = Preparation { part, ..self.run.clone() };
        let state = serde_json::to_value(run).map_err(|e| Error::invalid("options", e, "finite numbers"))?;
        let outputs = RunOptions { prepares: Some((state, self.spending)), ..self.outputs.clone() };
        Ok(TrainRun { outputs, resume, force_resume: self.force_resume, ..training })
    }
}

/// The error of a run that was stopped in `what`, a training that it needs.
pub(super) fn stopped(what: &str, training: &Trained) -> Error {
    let steps = counted(training.options.steps, "step");
    let place = format!("stopped in {what}, after {} of {steps}", training.steps);
    match &training.checkpoint {
        Some(path) => Error::Stopped { what: place, checkpoint: Some(path.clone()) },
        None => {
            let why = match training.lost.is_empty() {
                true => "`checkpoint` names no file".to_owned(),
                false => training.lost.join("; "),
            };
            Error::Stopped { what: format!("{place}; nothing was written: {why}"), checkpoint: None }
        }
    }
}
