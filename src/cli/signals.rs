//! Requests to end the program. On Unix: Ctrl-C (SIGINT), SIGTERM, SIGQUIT and a closed terminal
//! (SIGHUP). On Windows, which has no SIGTERM: Ctrl-C, Ctrl-Break and closing the console, which
//! leaves the program some seconds.
//!
//! While an observer listens, the first one is a request. Otherwise, and the second time, it ends
//! the program at once and removes its temporary files.

use std::process::ExitCode;
use std::sync::atomic::{AtomicI32, AtomicUsize, Ordering};
use trisplat_scene::{atomic, process};

/// Number of listening observers.
static LISTENERS: AtomicUsize = AtomicUsize::new(0);
static RECEIVED: AtomicI32 = AtomicI32::new(0);
/// The offset of exit codes for signals in shells.
const EXIT_BASE: i32 = 128;

/// Begins to wait for signals. Must be called before there are threads.
#[cfg(unix)]
pub(super) fn start() {
    use nix::sys::signal::{SigSet, Signal};
    // A program started by nohup, or as a shell's background job, must outlive the terminal.
    let heeded = [Signal::SIGHUP, Signal::SIGQUIT]
        .into_iter()
        .filter(|signal| !process::ignores(*signal as i32));
    let set: SigSet = [Signal::SIGINT, Signal::SIGTERM].into_iter().chain(heeded).collect();
    if set.thread_block().is_err() {
        return;
    }
    let wait = move || {
        while let Ok(signal) = set.wait() {
            receive(signal as i32);
        }
    };
    if std::thread::Builder::new().name("signals".into()).spawn(wait).is_err() {
        // Then they end the program as usual.
        let _ = set.thread_unblock();
    }
}

/// Begins to wait for Ctrl-C, Ctrl-Break and the closing of the console.
#[cfg(not(unix))]
pub(super) fn start() {
    /// The number of SIGINT.
    const INTERRUPT: i32 = 2;
    // Without a handler they end the program as usual.
    let _ = ctrlc::set_handler(|| receive(INTERRUPT));
}

fn receive(signal: i32) {
    let is_first = RECEIVED.swap(signal, Ordering::Relaxed) == 0;
    if !is_first || LISTENERS.load(Ordering::Relaxed) == 0 {
        process::end_all();
        atomic::remove_temporaries();
        std::process::exit(EXIT_BASE + signal);
    }
}

/// The exit code of a run that was asked to end: 130 after Ctrl-C, 143 after SIGTERM, 129 after
/// SIGHUP, 131 after SIGQUIT.
pub(super) fn exit_code() -> Option<u8> {
    match RECEIVED.load(Ordering::Relaxed) {
        0 => None,
        signal => u8::try_from(EXIT_BASE + signal).ok(),
    }
}

/// The end of a run that may have been stopped.
pub(super) fn ended() -> ExitCode {
    exit_code().map_or(ExitCode::SUCCESS, ExitCode::from)
}

/// An observer that stops cleanly when asked to.
#[derive(Debug)]
pub(super) struct Listener;

impl Listener {
    /// From here on the first request goes to this observer, and to all others.
    pub(super) fn new() -> Self {
        LISTENERS.fetch_add(1, Ordering::Relaxed);
        Self
    }

    /// True after a request to stop.
    pub(super) fn is_asked(&self) -> bool {
        exit_code().is_some()
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        LISTENERS.fetch_sub(1, Ordering::Relaxed);
    }
}
