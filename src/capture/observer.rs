//! Who watches a capture.

use crate::report::Observer;

/// Watches a capture; its steps are the stages of an [`Observer`]. Every method does nothing unless implemented.
pub trait CaptureObserver: Observer {
    /// What the running step is doing now.
    fn noted(&mut self, _what: &str) {}
    /// Asked often: what was done so far is kept, and the next run goes on from there.
    fn wants_to_stop(&mut self) -> bool {
        false
    }
}

/// Observes nothing.
impl CaptureObserver for () {}
