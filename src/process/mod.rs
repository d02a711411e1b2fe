//! What a process has used: CPU seconds and memory, from the system's own accounting.

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
    /// User and system seconds on all threads; 0 where the system does not report it.
    pub cpu_secs: f64,
    /// The most memory that was resident, bytes; 0 where the system does not report it.
    pub peak_bytes: u64,
}

/// User and system seconds this process has used on all threads; 0 where the system does not report it.
pub fn cpu_secs() -> f64 {
    system::this_process().cpu_secs
}

/// The most memory this process has held, bytes; 0 where the system does not report it.
pub fn peak_bytes() -> u64 {
    system::this_process().peak_bytes
}

/// True when whoever started this process has it ignore the signal of this number, as `nohup` does with SIGHUP.
#[cfg(unix)]
pub fn ignores(signal: i32) -> bool {
    system::ignores(signal)
}

/// What `child` used, which has ended and was waited for. Unix adds up the seconds of all children so far and keeps
/// the largest memory of any, so there `child` must have been the only one.
pub fn of_only_child(child: &Child) -> ProcessUsage {
    system::ended_child(child)
}
