//! CPU seconds and memory of a process, from the system's accounting.

pub mod memory;
pub mod running;

use std::process::Child;

#[cfg(not(any(unix, windows)))]
#[path = "other.rs"]
mod system;
#[cfg(unix)]
#[path = "unix.rs"]
mod system;
#[cfg(windows)]
#[path = "windows.rs"]
mod system;

/// What a process has used.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct ProcessUsage {
    /// User and system seconds on all threads; 0 if the system does not report them.
    pub cpu_secs: f64,
    /// Peak resident memory, bytes; 0 if the system does not report it.
    pub peak_bytes: u64,
}

/// User and system seconds of this process on all threads; 0 if the system does not report them.
pub fn cpu_secs() -> f64 {
    system::this_process().cpu_secs
}

/// Peak memory of this process, bytes; 0 if the system does not report it.
pub fn peak_bytes() -> u64 {
    system::this_process().peak_bytes
}

/// True when this process was started to ignore the signal of this number, as `nohup` does for SIGHUP.
#[cfg(unix)]
pub fn ignores(signal: i32) -> bool {
    system::ignores(signal)
}

/// The usage of `child`, which has ended and was waited for. Unix sums the seconds of all children so far and
/// keeps the largest memory of any, so `child` must have been the only one there.
pub fn of_only_child(child: &Child) -> ProcessUsage {
    system::ended_child(child)
}
