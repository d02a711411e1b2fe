//! How a capture ends before it is done.

use crate::error::Error;

/// Why there is no result.
#[derive(Debug)]
pub(super) enum Halt {
    /// Somebody wanted it to stop: what was done is kept.
    Stopped,
    /// It cannot be done.
    Failed(Error),
}

impl From<Error> for Halt {
    fn from(error: Error) -> Self {
        Self::Failed(error)
    }
}

/// What the steps of a capture return.
pub(super) type Step<T> = std::result::Result<T, Halt>;
