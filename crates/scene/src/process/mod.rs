//! Processes: CPU seconds and memory from the system's accounting, and programs that end with this
//! one.

use std::io;
use std::process::{Child, ChildStdout, Command, ExitStatus};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// CPU time and memory that a process has used.
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

/// Return freed memory that the allocator keeps to the system: glibc keeps the arena of each thread
/// of a decoder.
pub fn release_freed() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    system::release_freed();
}

/// True when this process was started to ignore the signal of this number, as `nohup` does for
/// SIGHUP.
#[cfg(unix)]
pub fn ignores(signal: i32) -> bool {
    system::ignores(signal)
}

/// The usage of `child`, which has ended and was waited for. Unix sums the seconds of all children
/// so far and keeps the largest memory of any, so `child` must have been the only one there.
pub fn of_only_child(child: &Child) -> ProcessUsage {
    system::ended_child(child)
}

/// `getrusage`.
#[cfg(unix)]
mod system {
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
        // SAFETY: without a new action the call only fills in the current one, which lives through
        // it; zeros are a valid one.
        #[allow(unsafe_code, reason = "the system's interface")]
        unsafe {
            libc::sigaction(signal, std::ptr::null(), action.as_mut_ptr()) == 0
                && action.assume_init().sa_sigaction == libc::SIG_IGN
        }
    }

    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    pub(super) fn release_freed() {
        // SAFETY: it takes no pointer, and frees no memory in use.
        #[allow(unsafe_code, reason = "the system's interface")]
        unsafe {
            libc::malloc_trim(0);
        }
    }

    fn usage(who: UsageWho) -> ProcessUsage {
        getrusage(who).map_or_else(
            |_| ProcessUsage::default(),
            |usage| ProcessUsage {
                cpu_secs: (usage.user_time() + usage.system_time()).num_microseconds() as f64
                    * 1e-6,
                peak_bytes: usage.max_rss().max(0) as u64 * RSS_UNIT_BYTES,
            },
        )
    }
}

/// `GetProcessTimes` and `K32GetProcessMemoryInfo`, which answer for ended processes too while
/// their handle is open.
#[cfg(windows)]
#[allow(unsafe_code, reason = "the system's interface")]
mod system {
    use super::ProcessUsage;
    use std::os::windows::io::AsRawHandle;
    use std::process::Child;
    use windows_sys::Win32::Foundation::{FILETIME, HANDLE};
    use windows_sys::Win32::System::ProcessStatus::{
        K32GetProcessMemoryInfo, PROCESS_MEMORY_COUNTERS,
    };
    use windows_sys::Win32::System::Threading::{GetCurrentProcess, GetProcessTimes};

    pub(super) fn this_process() -> ProcessUsage {
        // SAFETY: takes nothing and returns a constant that stands for this process and need not be
        // closed.
        usage(unsafe { GetCurrentProcess() })
    }

    pub(super) fn ended_child(child: &Child) -> ProcessUsage {
        usage(child.as_raw_handle())
    }

    fn usage(process: HANDLE) -> ProcessUsage {
        let mut times = [FILETIME::default(); 4];
        let [created, ended, kernel, user] = &mut times;
        // SAFETY: the four pointers are to values that live through the call; a handle that is not
        // one makes it fail.
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
}

/// Systems that do not report the usage of processes.
#[cfg(not(any(unix, windows)))]
mod system {
    use super::ProcessUsage;
    use std::process::Child;

    pub(super) fn this_process() -> ProcessUsage {
        ProcessUsage::default()
    }

    pub(super) fn ended_child(_: &Child) -> ProcessUsage {
        ProcessUsage::default()
    }
}

// ---- Programs that this process starts, and ends when it ends itself ----------------------------

/// Interval at which the end of a program is checked.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// The running programs, by process number.
static RUNNING: Mutex<Vec<u32>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<u32>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends every running program; for a process that ends without dropping its values.
pub fn end_all() {
    let list = running();
    for &id in list.iter() {
        kill(id);
    }
    // From here on no program starts, and no number is reused.
    std::mem::forget(list);
}

/// A running program; dropping ends it.
#[derive(Debug)]
pub struct Running {
    child: Child,
    ended: bool,
}

impl Running {
    /// Starts `command` in a group of its own: Ctrl-C in the terminal reaches only this process,
    /// which ends the program.
    ///
    /// # Errors
    ///
    /// Errors of the operating system, for example a missing program.
    pub fn start(command: &mut Command) -> io::Result<Self> {
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        let mut list = running();
        let child = command.spawn()?;
        list.push(child.id());
        Ok(Self { child, ended: false })
    }

    /// Its standard output, if that is a pipe; once.
    pub fn output(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// Its exit status, if it has ended.
    pub fn has_ended(&mut self) -> io::Result<Option<ExitStatus>> {
        // Its number is no longer used to end it, because the system may reuse it.
        let mut list = running();
        let status = self.child.try_wait()?;
        if status.is_some() && !self.ended {
            self.ended = true;
            list.retain(|&id| id != self.child.id());
        }
        Ok(status)
    }

    /// Waits until it has ended.
    pub fn wait(&mut self) -> io::Result<ExitStatus> {
        loop {
            if let Some(status) = self.has_ended()? {
                return Ok(status);
            }
            std::thread::sleep(POLL_INTERVAL);
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if !self.ended {
            kill(self.child.id());
            // A program that cannot be waited for has no owner any more.
            let _ = self.wait();
        }
    }
}

/// Ends a program and its children.
#[cfg(unix)]
fn kill(id: u32) {
    use nix::sys::signal::{Signal, killpg};
    if let Ok(id) = i32::try_from(id) {
        // One that has ended already needs no signal.
        let _ = killpg(nix::unistd::Pid::from_raw(id), Signal::SIGKILL);
    }
}

#[cfg(windows)]
fn kill(id: u32) {
    use std::process::Stdio;
    let kill = ["/T", "/F", "/PID"].map(String::from).into_iter().chain([id.to_string()]);
    // One that has ended already needs none.
    let _ =
        Command::new("taskkill").args(kill).stdout(Stdio::null()).stderr(Stdio::null()).status();
}

#[cfg(not(any(unix, windows)))]
fn kill(_: u32) {}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use std::io::Read;
    use std::process::Stdio;
    use std::time::Instant;

    #[test]
    fn a_program_ends_with_what_it_started() {
        let mut command = Command::new("sh");
        command.args(["-c", "sleep 100 & echo $!; wait"]).stdout(Stdio::piped());
        let mut program = Running::start(&mut command).unwrap();
        let mut said = program.output().unwrap();
        let mut digits = Vec::new();
        while !digits.ends_with(b"\n") {
            let mut byte = [0];
            said.read_exact(&mut byte).unwrap();
            digits.push(byte[0]);
        }
        let started: i32 = String::from_utf8(digits).unwrap().trim().parse().unwrap();
        let began = Instant::now();
        let id = program.child.id();
        drop(program);
        // Ended, or waiting to be reaped; a killed process may still have to be scheduled.
        let state = || std::fs::read_to_string(format!("/proc/{started}/stat")).unwrap_or_default();
        let ended = || state().is_empty() || state().contains(") Z");
        while !ended() && began.elapsed() < Duration::from_secs(3) {
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(ended(), "{}", state());
        assert!(!running().contains(&id));
    }

    #[test]
    fn a_program_says_how_it_ended() {
        let mut program = Running::start(Command::new("sh").args(["-c", "exit 3"])).unwrap();
        assert_eq!(program.wait().unwrap().code(), Some(3));
        assert!(Running::start(&mut Command::new("no-such-program-anywhere")).is_err());
    }
}
