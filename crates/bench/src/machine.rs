//! On what a number was measured, and what one process costs.
//!
//! The system's accounting of finished children is exact, but on Unix its memory figure is the
//! largest over *all* children so far. So every command is run as the only child of a fresh copy of
//! this program (`trisplat-bench measure COMMAND`), which prints the figures.

use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::process::{Command, Stdio};
use std::time::Instant;
use trisplat_scene::process::{self, ProcessUsage};
use trisplat_scene::{Error, Result};

/// The machine and the state of the code.
#[derive(Debug, Clone, Default, Serialize)]
pub(crate) struct Machine {
    /// Day as YYYY-MM-DD, UTC.
    date: String,
    /// Commit of the working tree the program runs in, when it is one.
    commit: String,
    /// Processor and number of cores.
    cpu: String,
}

impl Machine {
    /// This one.
    pub(crate) fn here() -> Self {
        let cpu = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
        let model =
            cpu.lines().find_map(|l| l.strip_prefix("model name")).unwrap_or(": unknown processor");
        let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
        Self {
            date: first_line(&["date", "-u", "+%Y-%m-%d"]),
            commit: first_line(&["git", "rev-parse", "--short", "HEAD"]),
            cpu: format!("{} x {cores}", model.trim_start_matches([' ', '\t', ':'])),
        }
    }
}

/// First line that a command prints; empty when it cannot be run.
fn first_line(command: &[&str]) -> String {
    let output = Command::new(command[0]).args(&command[1..]).output().ok();
    let said = output.filter(|o| o.status.success()).and_then(|o| String::from_utf8(o.stdout).ok());
    said.and_then(|s| s.lines().next().map(str::to_owned)).unwrap_or_default()
}

/// The cost of one process.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(crate) struct Usage {
    /// Seconds from start to end.
    pub(crate) wall_seconds: f64,
    /// User plus system seconds, over all threads.
    pub(crate) cpu_seconds: f64,
    /// Largest resident memory.
    pub(crate) peak_bytes: u64,
}

/// Runs `command` as a child of this process, which must not have had others; its output is thrown
/// away.
///
/// # Errors
/// A program that cannot be started, or fails.
pub(crate) fn run_only_child(command: &[OsString]) -> Result<Usage> {
    let Some((program, arguments)) = command.split_first() else {
        return Err(Error::invalid("COMMAND", "nothing", "a program and its arguments"));
    };
    let clock = Instant::now();
    let io = |e| Error::io(program, e);
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .spawn()
        .map_err(io)?;
    let status = child.wait().map_err(io)?;
    let wall_seconds = clock.elapsed().as_secs_f64();
    if !status.success() {
        return Err(Error::unsupported(program, format!("ended with {status}")));
    }
    let ProcessUsage { cpu_secs, peak_bytes } = process::of_only_child(&child);
    Ok(Usage { wall_seconds, cpu_seconds: cpu_secs, peak_bytes })
}

/// The cost of `command`, measured by a fresh copy of this program.
pub(crate) fn measure(command: &[OsString]) -> Result<Usage> {
    let this = std::env::current_exe().map_err(|e| Error::io("trisplat-bench", e))?;
    let done = Command::new(&this)
        .args(["measure", "--"])
        .args(command)
        .output()
        .map_err(|e| Error::io(&this, e))?;
    if !done.status.success() {
        let said = String::from_utf8_lossy(&done.stderr).trim().to_owned();
        return Err(Error::unsupported(&this, said));
    }
    serde_json::from_slice(&done.stdout)
        .map_err(|e| Error::malformed(&this, "measure", e.to_string()))
}

/// Prints `value` to standard output.
pub(crate) fn print_json(value: &impl serde::Serialize) -> Result<()> {
    let text = serde_json::to_string_pretty(value);
    println!("{}", text.map_err(|e| Error::malformed("-", "JSON", e.to_string()))?);
    Ok(())
}
