//! What this process has used: CPU seconds and memory.

use nix::sys::resource::{UsageWho, getrusage};
use nix::sys::time::TimeValLike;

/// User and system seconds this process has used on all threads; 0 where the system does not report it.
pub fn cpu_secs() -> f64 {
    let secs = |time: nix::sys::time::TimeVal| time.num_microseconds() as f64 * 1e-6;
    getrusage(UsageWho::RUSAGE_SELF).map_or(0.0, |u| secs(u.user_time()) + secs(u.system_time()))
}

/// The most memory this process has held, bytes; 0 where the system does not report it.
pub fn peak_bytes() -> u64 {
    getrusage(UsageWho::RUSAGE_SELF).map_or(0, |u| u.max_rss().max(0) as u64 * RSS_UNIT_BYTES)
}

/// What resident memory is counted in: KiB on Linux, bytes on macOS.
pub const RSS_UNIT_BYTES: u64 = if cfg!(target_os = "macos") { 1 } else { 1024 };
