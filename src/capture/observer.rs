//! The observer of a capture.

use crate::report::Observer;

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
