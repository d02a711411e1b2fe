//! Findings, and the list that collects them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use trisplat_scene::{Error, Result};

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// A note that needs no action.
    Note,
    /// The file works, but less well than it could.
    Warning,
    /// The file breaks its format's rules or cannot be drawn.
    Error,
}

/// One thing found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Finding {
    /// How bad it is.
    pub severity: Severity,
    /// Where: "accessor 3", "triangles 5, 17, 230 and 12 more".
    pub place: String,
    /// The fault and the remedy.
    pub what: String,
}

/// Collects findings.
#[derive(Debug, Default)]
pub(crate) struct Findings {
    /// In the order of the file.
    pub(crate) list: Vec<Finding>,
}

impl Findings {
    /// Adds one thing found at `place`.
    pub(crate) fn add(&mut self, severity: Severity, place: impl Into<String>, what: impl Into<String>) {
        self.list.push(Finding { severity, place: place.into(), what: what.into() });
    }

    /// Adds a fault.
    pub(crate) fn error(&mut self, place: impl Into<String>, what: impl Into<String>) {
        self.add(Severity::Error, place, what);
    }

    /// Adds a warning.
    pub(crate) fn warning(&mut self, place: impl Into<String>, what: impl Into<String>) {
        self.add(Severity::Warning, place, what);
    }

    /// True when this place has a finding already.
    pub(crate) fn has_place(&self, place: &str) -> bool {
        self.list.iter().any(|finding| finding.place == place)
    }

    /// Turns the error of a broken file into a finding; errors of the system stay errors.
    pub(crate) fn take(&mut self, error: Error) -> Result<()> {
        match error {
            Error::Io { .. } => return Err(error),
            Error::Malformed { at, reason, .. } => self.error(at, reason),
            Error::Unsupported { reason, .. } => self.error("file", reason),
            other => self.error("file", other.to_string()),
        }
        Ok(())
    }
}
