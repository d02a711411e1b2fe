//! Child programs: they and their own children are ended when their work is no longer needed, and none
//! outlives this process.

use std::io;
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Time for a program to end cleanly.
const PATIENCE: Duration = Duration::from_secs(3);
const TICK: Duration = Duration::from_millis(20);

/// The running programs, by process number.
static RUNNING: Mutex<Vec<u32>> = Mutex::new(Vec::new());

fn running() -> MutexGuard<'static, Vec<u32>> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Ends every program that this process has started and not waited for; for a process that ends without
/// dropping its values.
pub fn end_all() {
    let list = running();
    list.iter().for_each(|&id| signal(id, Force::Kill));
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
    /// Starts `command` with the standard input that it has, in a group of its own: Ctrl-C in the terminal
    /// reaches only this process, which ends the program.
    ///
    /// Errors: those of the operating system, for example a missing program.
    pub fn start(command: &mut Command) -> io::Result<Self> {
        command.stdout(Stdio::piped()).stderr(Stdio::piped());
        #[cfg(unix)]
        std::os::unix::process::CommandExt::process_group(command, 0);
        let mut list = running();
        let child = command.spawn()?;
        list.push(child.id());
        Ok(Self { child, ended: false })
    }

    /// Its standard output and its standard error; once.
    pub fn pipes(&mut self) -> (Option<ChildStdout>, Option<ChildStderr>) {
        (self.child.stdout.take(), self.child.stderr.take())
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

    /// Ends it, cleanly if it handles the signal.
    pub fn stop(&mut self) {
        for force in [Force::Ask, Force::Kill] {
            let asked = Instant::now();
            if !self.ended {
                signal(self.child.id(), force);
            }
            while !self.ended && asked.elapsed() < PATIENCE {
                match self.has_ended() {
                    Ok(None) => std::thread::sleep(TICK),
                    // What cannot be waited for is nobody's any more.
                    _ => break,
                }
            }
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.stop();
    }
}

#[derive(Debug, Clone, Copy)]
enum Force {
    Ask,
    Kill,
}

/// Reaches a program and its children.
#[cfg(unix)]
fn signal(id: u32, force: Force) {
    use nix::sys::signal::{Signal, killpg};
    let signal = match force {
        Force::Ask => Signal::SIGTERM,
        Force::Kill => Signal::SIGKILL,
    };
    if let Ok(id) = i32::try_from(id) {
        // One that has ended already needs no signal.
        let _ = killpg(nix::unistd::Pid::from_raw(id), signal);
    }
}

#[cfg(windows)]
fn signal(id: u32, _: Force) {
    let kill = ["/T", "/F", "/PID"].map(String::from).into_iter().chain([id.to_string()]);
    // One that has ended already needs none.
    let _ = Command::new("taskkill").args(kill).stdout(Stdio::null()).stderr(Stdio::null()).status();
}

#[cfg(not(any(unix, windows)))]
fn signal(_: u32, _: Force) {}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::io::Read;

    #[test]
    fn a_program_ends_with_what_it_started() {
        let mut command = Command::new("sh");
        command.args(["-c", "sleep 100 & echo $!; wait"]);
        let mut program = Running::start(&mut command).unwrap();
        let (mut said, mut digits) = (program.pipes().0.unwrap(), Vec::new());
        while !digits.ends_with(b"\n") {
            let mut byte = [0];
            said.read_exact(&mut byte).unwrap();
            digits.push(byte[0]);
        }
        let started: i32 = String::from_utf8(digits).unwrap().trim().parse().unwrap();
        let began = Instant::now();
        program.stop();
        assert!(began.elapsed() < PATIENCE);
        // Ended, or waiting to be reaped; a killed process may still have to be scheduled.
        let state = || std::fs::read_to_string(format!("/proc/{started}/stat")).unwrap_or_default();
        let ended = || state().is_empty() || state().contains(") Z");
        while !ended() && began.elapsed() < PATIENCE {
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(ended(), "{}", state());
        assert!(running().is_empty() || !running().contains(&program.child.id()));
    }

    #[test]
    fn a_program_says_how_it_ended() {
        let mut program = Running::start(Command::new("sh").args(["-c", "exit 3"])).unwrap();
        assert_eq!(program.wait().unwrap().code(), Some(3));
        assert!(Running::start(&mut Command::new("no-such-program-anywhere")).is_err());
    }
}
