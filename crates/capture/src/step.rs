//! The result of a capture's step, which may end early.

use trisplat_scene::{
    Error,
    report::{StageEvent, StageObserver},
};

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

/// Tells `observer`, which may stop the capture; the next run continues from there.
pub(super) fn tell(observer: StageObserver<'_>, event: StageEvent<'_>) -> Step<()> {
    if observer(event).is_break() { Err(Halt::Stopped) } else { Ok(()) }
}
