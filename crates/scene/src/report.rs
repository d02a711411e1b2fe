//! The report of a run: one entry per stage, printed by the command line and written by `--report`.
//!
//! A stage has its own type of measurements, which implements [`StageDetails`]. The report stores
//! it as JSON, because it does not depend on stages; [`Report::details`] returns it typed.

use crate::error::{Error, Result};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use std::ops::ControlFlow;
use std::time::Instant;

/// A number and its noun: "1 step", "2 steps".
pub fn counted(number: u64, noun: &str) -> String {
    format!("{number} {noun}{}", if number == 1 { "" } else { "s" })
}

/// The outcome of a stage, which may be skipped.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome<T> {
    /// The stage did its work, with this result.
    Changed(T),
    /// There was nothing to do, for this reason; the input is unchanged. Options are named by their
    /// fields, in backticks.
    Skipped(&'static str),
}

/// Sizes before and after a stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Counts {
    /// Triangles.
    pub triangles: u64,
    /// Vertices.
    pub vertices: u64,
}

/// The measurements of a stage: counts by cause, errors, sizes. Fields that do not apply are `None`
/// and absent in JSON.
pub trait StageDetails: Default + PartialEq + Serialize + DeserializeOwned + JsonSchema {
    /// The name of the stage, also of its file, its option group, its test and its entry in the
    /// report.
    const STAGE: &'static str;
}

/// One line of the stage table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct StageReport {
    /// The stage: the name of its file, its option group and its test.
    pub name: String,
    /// Wall-clock seconds.
    pub seconds: f64,
    /// Sizes when it started.
    pub before: Counts,
    /// Sizes when it ended.
    pub after: Counts,
    /// The reason if there was nothing to do. Options are named by their fields, in backticks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub skipped: Option<String>,
    /// The measurements of this stage, as JSON; [`StageReport::details_as`] returns them typed.
    #[serde(default, skip_serializing_if = "Map::is_empty")]
    pub details: Map<String, Value>,
}

impl StageReport {
    /// The report of a stage with nothing to do, for this reason.
    pub fn skipped(name: &str, why: String) -> Self {
        Self {
            name: name.to_owned(),
            seconds: 0.0,
            before: Counts::default(),
            after: Counts::default(),
            skipped: Some(why),
            details: Map::new(),
        }
    }

    /// The measurements of this stage; `None` if `D` belongs to another stage or there are none.
    pub fn details_as<D: StageDetails>(&self) -> Option<D> {
        let own = self.name == D::STAGE && !self.details.is_empty();
        own.then(|| serde_json::from_value(Value::Object(self.details.clone())).ok()).flatten()
    }
}

/// Event of a stage of a run.
#[derive(Debug)]
pub enum StageEvent<'a> {
    /// A stage starts.
    Started(&'a str),
    /// Progress of the running stage, a fraction from 0 to 1. Only stages that may take long report
    /// it.
    Progressed(f64),
    /// Status text of the running stage.
    Noted(&'a str),
    /// Nothing new: an occasion to stop.
    Waiting,
    /// A stage ended.
    Finished(&'a StageReport),
}

/// Receives the events of stages. `ControlFlow::Break` at the start or the end of a stage stops the
/// run; in a capture, at any event.
pub type StageObserver<'a> = &'a mut dyn FnMut(StageEvent<'_>) -> ControlFlow<()>;

/// Reports the progress of a stage to an observer.
pub struct StageProgress<'a> {
    observer: StageObserver<'a>,
    /// Start of this part within the stage, a fraction from 0 to 1.
    start: f64,
    /// Length of this part, a fraction of the stage.
    length: f64,
}

impl<'a> StageProgress<'a> {
    /// Progress of a whole stage.
    pub fn new(observer: StageObserver<'a>) -> Self {
        Self { observer, start: 0.0, length: 1.0 }
    }

    /// The progress of a part, from one fraction of this one to another.
    pub fn part(&mut self, from: f64, to: f64) -> StageProgress<'_> {
        StageProgress {
            observer: &mut *self.observer,
            start: self.start + self.length * from,
            length: self.length * (to - from),
        }
    }

    /// Reports `done` of `all` steps.
    pub fn set(&mut self, done: usize, all: usize) {
        self.progressed(done as f64 / all.max(1) as f64);
    }

    /// The observer of inner stages, whose fractions this passes on.
    pub fn inner(&mut self) -> impl FnMut(StageEvent<'_>) -> ControlFlow<()> {
        |event| {
            if let StageEvent::Progressed(fraction) = event {
                self.progressed(fraction);
            }
            ControlFlow::Continue(())
        }
    }

    /// Reports a fraction of this part, from 0 to 1.
    pub fn progressed(&mut self, fraction: f64) {
        let of_stage = self.start + self.length * fraction.clamp(0.0, 1.0);
        // No stage is left half done.
        let _ = (self.observer)(StageEvent::Progressed(of_stage));
    }
}

/// Everything one run did, in the shape of `schemas/report.schema.json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat report")]
pub struct Report {
    /// Program and version.
    pub generator: String,
    /// The command: "bake" or "train".
    pub command: String,
    /// Files read.
    pub inputs: Vec<String>,
    /// Files written, or those that a dry run would have written.
    pub outputs: Vec<OutputReport>,
    /// True when nothing was written on purpose.
    pub dry_run: bool,
    /// Stages in the order they ran.
    pub stages: Vec<StageReport>,
    /// Notes for the user, one sentence each.
    pub warnings: Vec<String>,
    /// The final options of the run, from preset, config file and flags.
    #[serde(default)]
    pub options: Value,
    /// Wall-clock seconds of the whole run.
    pub seconds: f64,
}

/// One file of the output.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OutputReport {
    /// Path as given.
    pub path: String,
    /// Size in bytes.
    pub bytes: u64,
}

impl Report {
    /// An empty report for `command`.
    pub fn new(command: &str) -> Self {
        Self { generator: generator(), command: command.to_owned(), ..Self::default() }
    }

    /// The measurements of a stage, if any.
    pub fn details<D: StageDetails>(&self) -> Option<D> {
        self.stages.iter().rev().find_map(StageReport::details_as)
    }

    /// Runs the stage that `D` belongs to, times it and records what it did. `measure` counts a
    /// value's triangles and vertices; `run` gets the value and empty details. Details are recorded
    /// if the stage changed or measured something.
    ///
    /// Returns the value, changed or as it came, and its details.
    pub fn stage<T, D: StageDetails>(
        &mut self,
        observer: StageObserver<'_>,
        input: T,
        measure: impl Fn(&T) -> Counts,
        run: impl FnOnce(&mut T, &mut D) -> Result<Outcome<()>>,
    ) -> Result<(T, D)> {
        self.long_stage(observer, input, measure, |value, details, _| run(value, details))
    }

    /// [`Report::stage`] for one that may take long: `run` also gets a function that reports
    /// progress to the observer.
    pub fn long_stage<T, D: StageDetails>(
        &mut self,
        observer: StageObserver<'_>,
        input: T,
        measure: impl Fn(&T) -> Counts,
        run: impl FnOnce(&mut T, &mut D, &mut StageProgress<'_>) -> Result<Outcome<()>>,
    ) -> Result<(T, D)> {
        go_on::<D>(observer(StageEvent::Started(D::STAGE)))?;
        let clock = Instant::now();
        let mut value = input;
        let before = measure(&value);
        let mut details = D::default();
        let skipped = match run(&mut value, &mut details, &mut StageProgress::new(observer))? {
            Outcome::Changed(()) => None,
            Outcome::Skipped(why) => Some(why.to_owned()),
        };
        let measured = skipped.is_none() || details != D::default();
        let stage = StageReport {
            name: D::STAGE.to_owned(),
            seconds: clock.elapsed().as_secs_f64(),
            before,
            after: measure(&value),
            skipped,
            details: if measured { to_json(&details) } else { Map::new() },
        };
        let told = observer(StageEvent::Finished(&stage));
        self.stages.push(stage);
        go_on::<D>(told)?;
        Ok((value, details))
    }
}

/// An error if an observer stops the run at the stage of `D`.
fn go_on<D: StageDetails>(told: ControlFlow<()>) -> Result<()> {
    match told {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => {
            let what = format!("stopped at the stage {}; nothing was written", D::STAGE);
            Err(Error::Stopped { what })
        }
    }
}

/// The details of a stage in the shape of [`StageReport::details`].
pub fn to_json<D: StageDetails>(details: &D) -> Map<String, Value> {
    match serde_json::to_value(details) {
        Ok(Value::Object(map)) => map,
        _ => Map::new(),
    }
}

/// The JSON Schema of the entry of the stage of `D`.
pub fn stage_schema<D: StageDetails>(generator: &mut SchemaGenerator) -> Schema {
    let details = generator.subschema_for::<D>();
    json_schema!({ "properties": { "name": { "const": D::STAGE }, "details": details } })
}

/// "trisplat 0.1.0": the generator named in files.
pub fn generator() -> String {
    format!("trisplat {}", env!("CARGO_PKG_VERSION"))
}
/// Names the stage that these details are of.
#[macro_export]
macro_rules! stage {
    ($details:ty, $name:literal) => {
        impl $crate::report::StageDetails for $details {
            const STAGE: &'static str = $name;
        }
    };
}

/// The default of options whose values are a constant.
#[macro_export]
macro_rules! default {
    ($options:ty) => {
        impl Default for $options {
            fn default() -> Self {
                Self::DEFAULT
            }
        }
    };
}
