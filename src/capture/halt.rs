//! Reasons for a capture to end early.

use crate::error::Error;

/// Reason for having no result.
#[derive(Debug)]
pub(super) enum Halt {
    /// Stopped by the observer; finished steps are kept.
    Stopped,
    /// An error.
    Failed(Error),
}

impl From<Error> for Halt {
    fn from(error: Error) -> Self {
        Self::Failed(error)
    }
}

/// Result of a capture step.
pub(super) type Step<T> = std::result::Result<T, Halt>;
