//! Windows: `GetProcessTimes` and `K32GetProcessMemoryInfo`, which answer for ended processes too while their handle
//! is open.
#![allow(unsafe_code)]

use super::ProcessUsage;
use std::os::windows::io::AsRawHandle;
use std::process::Child;
use windows_sys::Win32::Foundation::{FILETIME, HANDLE};
use windows_sys::Win32::System::ProcessStatus::{K32GetProcessMemoryInfo, PROCESS_MEMORY_COUNTERS};
use windows_sys::Win32::System::Threading::{GetCurrentProcess, GetProcessTimes};

pub(super) fn this_process() -> ProcessUsage {
    // SAFETY: takes nothing and returns a constant that stands for this process and need not be closed.
    usage(unsafe { GetCurrentProcess() })
}

pub(super) fn ended_child(child: &Child) -> ProcessUsage {
    usage(child.as_raw_handle())
}

fn usage(process: HANDLE) -> ProcessUsage {
    let mut times = [FILETIME::default(); 4];
    let [created, ended, kernel, user] = &mut times;
    // SAFETY: the four pointers are to values that live through the call; a handle that is not one makes it fail.
    let timed = unsafe { GetProcessTimes(process, created, ended, kernel, user) } != 0;
    let size = size_of::<PROCESS_MEMORY_COUNTERS>() as u32;
    let mut memory = PROCESS_MEMORY_COUNTERS { cb: size, ..Default::default() };
    // SAFETY: `memory` lives through the call and is `size` bytes long.
    let counted = unsafe { K32GetProcessMemoryInfo(process, &mut memory, size) } != 0;
    ProcessUsage {
        cpu_secs: if timed { secs(kernel) + secs(user) } else { 0.0 },
        peak_bytes: if counted { memory.PeakWorkingSetSize as u64 } else { 0 },
    }
}

/// A duration, which Windows counts in 100 ns.
fn secs(time: &FILETIME) -> f64 {
    (u64::from(time.dwHighDateTime) << 32 | u64::from(time.dwLowDateTime)) as f64 * 1e-7
}
