//! The run that a training prepares: a trial that decides about it, or its teacher.

use serde::{Deserialize, Serialize};

/// A run before its own first step, in the checkpoint of a training that it needs.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PreparedRun {
    /// Its state, for the job that began it.
    pub state: serde_json::Value,
    /// Seconds of its budget spent so far.
    pub spent_secs: f64,
}
