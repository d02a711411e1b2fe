//! What happened: one entry a stage, printed by the CLI and written by `--report`.

use crate::error::Result;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// What a stage did. "Skip what a scene doesn't need" is in the type and in the report.
#[derive(Debug, Clone, PartialEq)]
pub enum Outcome<T> {
    /// The stage did its work; the value holds what it made.
    Changed(T),
    /// There was nothing to do, and why; the input stands.
    Unneeded(&'static str),
}

/// Sizes before and after a stage.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Counts {
    /// Triangles.
    pub triangles: u64,
    /// Vertices.
    pub vertices: u64,
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
    /// Why there was nothing to do, when there was nothing to do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unneeded: Option<String>,
    /// Figures of this stage: counts by cause, errors, sizes.
    #[serde(default, skip_serializing_if = "serde_json::Map::is_empty")]
    pub details: serde_json::Map<String, serde_json::Value>,
}

/// Hears of every stage as it starts and ends: the CLI's progress bar and table.
pub trait Observer {
    /// A stage starts.
    fn started(&mut self, _name: &str) {}
    /// A stage ended.
    fn finished(&mut self, _stage: &StageReport) {}
}

/// Hears nothing.
impl Observer for () {}

/// Everything one run did, in the shape of `schemas/report.schema.json`.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[schemars(title = "trisplat report")]
pub struct Report {
    /// Program and version.
    pub generator: String,
    /// The command: "bake".
    pub command: String,
    /// Files read.
    pub inputs: Vec<String>,
    /// Files written, or that a dry run would have written.
    pub outputs: Vec<OutputReport>,
    /// True when nothing was written on purpose.
    pub dry_run: bool,
    /// Stages in the order they ran.
    pub stages: Vec<StageReport>,
    /// What the user should know, one sentence each.
    pub warnings: Vec<String>,
    /// The options the run used, after preset, config file and flags were laid over each other.
    #[serde(default)]
    pub options: serde_json::Value,
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

    /// Runs one stage, times it and records what it did. `measure` counts a value's triangles and
    /// vertices; `run` gets the value and a map for its own figures.
    ///
    /// Returns the changed value, or the input when there was nothing to do.
    pub fn stage<T>(
        &mut self,
        observer: &mut dyn Observer,
        name: &str,
        input: T,
        measure: impl Fn(&T) -> Counts,
        run: impl FnOnce(&mut T, &mut serde_json::Map<String, serde_json::Value>) -> Result<Outcome<()>>,
    ) -> Result<T> {
        observer.started(name);
        let clock = Instant::now();
        let mut value = input;
        let before = measure(&value);
        let mut details = serde_json::Map::new();
        let unneeded = match run(&mut value, &mut details)? {
            Outcome::Changed(()) => None,
            Outcome::Unneeded(why) => Some(why.to_owned()),
        };
        let stage = StageReport {
            name: name.to_owned(),
            seconds: clock.elapsed().as_secs_f64(),
            before,
            after: measure(&value),
            unneeded,
            details,
        };
        observer.finished(&stage);
        self.stages.push(stage);
        Ok(value)
    }
}

/// "trisplat 0.1.0": what we sign files with.
pub fn generator() -> String {
    format!("trisplat {}", env!("CARGO_PKG_VERSION"))
}
