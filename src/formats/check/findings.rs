//! What was found, and the list it is collected in.

use crate::error::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Worth knowing; nothing need be done.
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
    /// What is wrong and what would be right.
    pub what: String,
}

/// Collects findings.
#[derive(Debug, Default)]
pub(super) struct Findings {
    pub(super) list: Vec<Finding>,
    pub(super) positions: Positions,
}

/// Whether the positions of a file are bit for bit those that were baked, corners in the same order.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) enum Positions {
    #[default]
    AsBaked,
    /// Quantised or compressed.
    Encoded,
}

impl Findings {
    pub(super) fn add(&mut self, severity: Severity, place: impl Into<String>, what: impl Into<String>) {
        self.list.push(Finding { severity, place: place.into(), what: what.into() });
    }

    pub(super) fn error(&mut self, place: impl Into<String>, what: impl Into<String>) {
        self.add(Severity::Error, place, what);
    }

    pub(super) fn warning(&mut self, place: impl Into<String>, what: impl Into<String>) {
        self.add(Severity::Warning, place, what);
    }

    /// True when something was found there already.
    pub(super) fn has_place(&self, place: &str) -> bool {
        self.list.iter().any(|finding| finding.place == place)
    }

    /// A finding of its own for a file that is broken; what the system refused stays an error.
    pub(super) fn take(&mut self, error: Error) -> Result<()> {
        match error {
            Error::Io { .. } => return Err(error),
            Error::Malformed { at, reason, .. } => self.error(at, reason),
            Error::Unsupported { reason, .. } => self.error("file", reason),
            other => self.error("file", other.to_string()),
        }
        Ok(())
    }
}
