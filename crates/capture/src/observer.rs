//! The observer of a capture, and the reasons for it to end early.

use trisplat_scene::{Error, report::Observer};

/// Observes a capture; its steps are the stages of an [`Observer`]. By default every method does nothing.
pub trait CaptureObserver: Observer {
    /// Status text of the running step.
    fn noted(&mut self, _what: &str) {}
    /// Called often. Returning true stops the capture; the next run continues from there.
    fn wants_to_stop(&mut self) -> bool {
        false
    }
}

/// Observes nothing.
impl CaptureObserver for () {}

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
