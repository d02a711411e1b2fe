//! Programs that this process starts, and ends when it ends itself.

use std::io;
use std::process::{Child, ChildStdout, Command, ExitStatus};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

const TICK: Duration = Duration::from_millis(20);

/// The running programs, by process number.
static RUNNING: Mutex<Vec<u32>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<u32>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends every running program; for a process that ends without dropping its values.
pub fn end_all() {
    let list = running();
    list.iter().for_each(|&id| kill(id));
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
    /// Starts `command` in a group of its own: Ctrl-C in the terminal reaches only this process, which ends the program.
    ///
    /// Errors: those of the operating system, for example a missing program.
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
            std::thread::sleep(TICK);
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        if !self.ended {
            kill(self.child.id());
            // What cannot be waited for is nobody's any more.
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
    let _ = Command::new("taskkill").args(kill).stdout(Stdio::null()).stderr(Stdio::null()).status();
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
        let (mut said, mut digits) = (program.output().unwrap(), Vec::new());
        while !digits.ends_with(b"\n") {
            let mut byte = [0];
            said.read_exact(&mut byte).unwrap();
            digits.push(byte[0]);
        }
        let started: i32 = String::from_utf8(digits).unwrap().trim().parse().unwrap();
        let (began, id) = (Instant::now(), program.child.id());
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
