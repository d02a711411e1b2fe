//! Unix: `getrusage`.

use super::ProcessUsage;
use nix::libc;
use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;
use std::process::Child;

/// Unit of resident memory: bytes on Apple's systems, KiB elsewhere.
const RSS_UNIT_BYTES: u64 = if cfg!(target_vendor = "apple") { 1 } else { 1024 };

pub(super) fn this_process() -> ProcessUsage {
    usage(UsageWho::RUSAGE_SELF)
}

pub(super) fn ended_child(_: &Child) -> ProcessUsage {
    usage(UsageWho::RUSAGE_CHILDREN)
}

pub(super) fn ignores(signal: i32) -> bool {
    let mut action = std::mem::MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action the call only fills in the current one, which lives through it; zeros are a valid one.
    #[allow(unsafe_code, reason = "the system's interface")]
    unsafe {
        libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) == 0
            && action.assume_init().sa_sigaction == libc::SIG_IGN
    }
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
