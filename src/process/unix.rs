//! Unix: `getrusage`.

use super::ProcessUsage;
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use std::process::Child;

/// What resident memory is counted in: bytes on Apple's systems, KiB elsewhere.
const RSS_UNIT_BYTES: u64 = if cfg!(target_vendor = "apple") { 1 } else { 1024 };

pub(super) fn this_process() -> ProcessUsage {
    usage(UsageWho::RUSAGE_SELF)
}

pub(super) fn ended_child(_: &Child) -> ProcessUsage {
    usage(UsageWho::RUSAGE_CHILDREN)
}

fn usage(who: UsageWho) -> ProcessUsage {
    getrusage(who).map_or_else(
        |_| ProcessUsage::default(),
        |usage| ProcessUsage {
            cpu_secs: (usage.user_time() + usage.system_time()).num_microseconds() as f64 * 1e-6,
            peak_bytes: usage.max_rss().max(0) as u64 * RSS_UNIT_BYTES,
        },
    )
}
