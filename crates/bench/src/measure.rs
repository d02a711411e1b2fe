//! What a command costs: wall time, CPU time and peak memory of one whole process.
//!
//! The system's accounting of finished children is exact, but on Unix its memory figure is the
//! largest over *all* children so far. So every command is run as the only child of a fresh copy of
//! this program (`trisplat bench measure -- COMMAND`), which prints the figures.

use serde::{Deserialize, Serialize};
use std::ffi::OsString;
use std::io::Read;
use std::process::{Command, Stdio};
use std::time::Instant;
use trisplat_scene::{
    Error, Result,
    process::{self, ProcessUsage},
};

/// The cost of one process.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Usage {
    /// Seconds from start to end.
    pub wall_seconds: f64,
    /// User plus system seconds, over all threads.
    pub cpu_seconds: f64,
    /// Largest resident memory.
    pub peak_bytes: u64,
}

/// Runs `command` as a child of this process, its output thrown away. This process must not have had
/// other children. Errors: it cannot be started, or it fails.
pub fn run_only_child(command: &[OsString]) -> Result<Usage> {
    let Some((program, arguments)) = command.split_first() else {
        return Err(Error::invalid("COMMAND", "nothing", "a program and its arguments"));
    };
    let clock = Instant::now();
    let io = |e| Error::io(program, e);
    let mut child = Command::new(program)
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(io)?;
    let mut said = Vec::new();
    child.stderr.take().map_or(Ok(0), |mut pipe| pipe.read_to_end(&mut said)).map_err(io)?;
    let status = child.wait().map_err(io)?;
    let wall_seconds = clock.elapsed().as_secs_f64();
    if !status.success() {
        let said = String::from_utf8_lossy(&said).trim().to_owned();
        return Err(Error::unsupported(program, format!("ended with {status}: {said}")));
    }
    let ProcessUsage { cpu_secs, peak_bytes } = process::of_only_child(&child);
    Ok(Usage { wall_seconds, cpu_seconds: cpu_secs, peak_bytes })
}

/// The cost of `command`, measured by a fresh copy of this program.
pub fn measure(command: &[OsString]) -> Result<Usage> {
    let this = std::env::current_exe().map_err(|e| Error::io("trisplat", e))?;
    let done = Command::new(&this)
        .args(["bench", "measure", "--"])
        .args(command)
        .output()
        .map_err(|e| Error::io(&this, e))?;
    if !done.status.success() {
        let said = String::from_utf8_lossy(&done.stderr).trim().to_owned();
        return Err(Error::unsupported(&this, said));
    }
    serde_json::from_slice(&done.stdout).map_err(|e| Error::malformed(&this, "measure", e.to_string()))
}
