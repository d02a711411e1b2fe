//! Runs that go on for a night.

use std::time::Duration;

/// How long they go on, from TRISPLAT_FUZZ_SECONDS: the mutants of each file, the faults of each
/// command.
pub(crate) fn duration() -> Duration {
    let seconds = std::env::var("TRISPLAT_FUZZ_SECONDS").ok().and_then(|text| text.parse().ok());
    Duration::from_secs(seconds.unwrap_or(0))
}
