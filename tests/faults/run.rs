//! Runs the program with a fault.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

/// What goes wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// One call fails (EIO).
    Error,
    /// The disk is full from this call on.
    Full,
    /// The program is killed before this call.
    Kill,
    /// The program is asked to end before this call: by SIGHUP, SIGINT, SIGQUIT or SIGTERM, one
    /// after the other.
    Signal,
}

/// Signals that ask a program to end, and what it exits with then.
const SIGNALS: [(i32, i32); 4] = [(1, 129), (2, 130), (3, 131), (15, 143)];

/// What goes wrong, and at which call, from 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fault {
    pub(crate) kind: Kind,
    pub(crate) at: u64,
}

impl Fault {
    /// The exit code of a program that heeds the signal.
    pub(crate) fn exit_code(&self) -> Option<i32> {
        (self.kind == Kind::Signal).then(|| SIGNALS[self.at as usize % SIGNALS.len()].1)
    }
}

/// The library that catches system calls.
pub(crate) struct Injector {
    folder: tempfile::TempDir,
}

/// A run of the program and the calls it made.
pub(crate) struct Run {
    pub(crate) output: Output,
    /// "write /full/path", by number.
    pub(crate) calls: Vec<String>,
    /// Holds what the program keeps in the system's folder for temporary files.
    pub(crate) temporary: tempfile::TempDir,
}

impl Injector {
    /// Compiles it; `None` where that is not possible.
    pub(crate) fn build() -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/faults/inject.c");
        let mut cc = Command::new("cc");
        cc.args(["-shared", "-fPIC", "-O1", "-o"])
            .arg(folder.path().join("inject.so"))
            .arg(source)
            .arg("-ldl");
        let built = cc.stderr(Stdio::null()).status().is_ok_and(|status| status.success());
        built.then_some(Self { folder })
    }

    /// Runs the program in `folder`, in which calls are caught.
    pub(crate) fn run(&self, folder: &Path, arguments: &[&str], fault: Option<Fault>) -> Run {
        let temporary = tempfile::tempdir().unwrap();
        let log: PathBuf = temporary.path().join("calls");
        let mut command = Command::new(env!("CARGO_BIN_EXE_trisplat"));
        command.args(arguments).args(["--threads", "1"]).current_dir(folder).stdin(Stdio::null());
        command
            .env("LD_PRELOAD", self.folder.path().join("inject.so"))
            .env("TMPDIR", temporary.path());
        command.env("FAULT_FOLDER", folder).env("FAULT_COUNT", &log);
        if let Some(Fault { kind, at }) = fault {
            let kind = match kind {
                Kind::Error => "error",
                Kind::Full => "full",
                Kind::Kill => "kill",
                Kind::Signal => "signal",
            };
            command.env("FAULT_SIGNAL", SIGNALS[at as usize % SIGNALS.len()].0.to_string());
            command.env("FAULT_KIND", kind).env("FAULT_AT", at.to_string());
        }
        let output = command.output().unwrap();
        let text = std::fs::read_to_string(&log).unwrap_or_default();
        let mut calls: Vec<(u64, String)> = text
            .lines()
            .filter_map(|line| {
                let (number, call) = line.split_once(' ')?;
                Some((number.parse().ok()?, call.to_owned()))
            })
            .collect();
        calls.sort();
        Run { output, calls: calls.into_iter().map(|(_, call)| call).collect(), temporary }
    }
}

impl Run {
    pub(crate) fn stderr(&self) -> String {
        String::from_utf8_lossy(&self.output.stderr).into_owned()
    }

    /// How many errors were printed.
    pub(crate) fn errors(&self) -> usize {
        self.stderr().lines().filter(|line| line.starts_with("error: ")).count()
    }
}
