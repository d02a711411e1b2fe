//! How long the parts of a frame take.

use std::sync::atomic::{AtomicU64, Ordering::Relaxed};
use std::time::{Duration, Instant};

/// Time spent in the parts of a frame that alternate, summed over threads, ns.
#[derive(Debug, Default)]
pub(super) struct PartTimes {
    pub(super) fill: AtomicU64,
    pub(super) resolve: AtomicU64,
}

impl PartTimes {
    /// Counts the time since `start` for `part`; returns now.
    pub(super) fn lap(part: &AtomicU64, start: Instant) -> Instant {
        let now = Instant::now();
        part.fetch_add((now - start).as_nanos() as u64, Relaxed);
        now
    }

    /// The wall-clock time of every part, ms: the time after binning is divided in proportion to the threads'
    /// times.
    pub(super) fn split(&self, binned: Duration, end: Duration) -> Vec<(&'static str, f64)> {
        let (fill, resolve) = (self.fill.load(Relaxed) as f64, self.resolve.load(Relaxed) as f64);
        let rest = (end - binned).as_secs_f64() * 1e3 / (fill + resolve).max(1.0);
        vec![("bin", binned.as_secs_f64() * 1e3), ("fill", fill * rest), ("resolve", resolve * rest)]
    }
}
