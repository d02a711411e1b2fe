//! Other programs under our eyes: every line they say goes into a log, and to whoever wants to know how far they are.

use super::halt::{Halt, Step};
use super::observer::CaptureObserver;
use crate::error::Error;
use crate::process::running::Running;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::time::Duration;

/// How often somebody is asked whether to stop.
const TICK: Duration = Duration::from_millis(100);
/// Lines that are kept for messages.
const KEPT: usize = 40;

/// The log of a capture. Programs add to it.
#[derive(Debug)]
pub(super) struct Log {
    pub(super) path: PathBuf,
    file: File,
}

/// How a program ended.
#[derive(Debug)]
pub(super) struct Ended {
    pub(super) status: ExitStatus,
    /// The last lines that it said.
    pub(super) said: Vec<String>,
}

impl Log {
    /// Goes on with the log at `path`.
    pub(super) fn open(path: &Path) -> Step<Self> {
        let file = File::options().create(true).append(true).open(path).map_err(|e| Error::io(path, e))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Runs `command` to its end, or until `observer` wants to stop. `hear` gets each line of both its outputs.
    pub(super) fn run(
        &mut self,
        command: &mut Command,
        observer: &mut dyn CaptureObserver,
        mut hear: impl FnMut(&str, &mut dyn CaptureObserver),
    ) -> Step<Ended> {
        self.write(&format!("$ {}", shown(command)))?;
        let mut program = start(command)?;
        let (lines, heard) = mpsc::channel();
        let (out, err) = program.pipes();
        let readers = [out.map(boxed), err.map(boxed)].into_iter().flatten();
        readers.for_each(|from| pass_lines(from, lines.clone()));
        drop(lines);
        let mut said = Vec::new();
        loop {
            match heard.recv_timeout(TICK) {
                Ok(line) => {
                    self.write(&line)?;
                    hear(&line, observer);
                    said.push(line);
                    if said.len() > 2 * KEPT {
                        said.drain(..KEPT);
                    }
                }
                // Somebody whom it started may hold its output for long.
                Err(RecvTimeoutError::Timeout) if program.has_ended().map_err(io_of(command))?.is_some() => {
                    break;
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            if observer.wants_to_stop() {
                program.stop();
                self.write("stopped")?;
                return Err(Halt::Stopped);
            }
        }
        let status = program.wait().map_err(io_of(command))?;
        self.write(&format!("{status}"))?;
        Ok(Ended { status, said })
    }

    /// [`Log::run`] of a program that has to succeed.
    pub(super) fn run_well(
        &mut self,
        command: &mut Command,
        observer: &mut dyn CaptureObserver,
        hear: impl FnMut(&str, &mut dyn CaptureObserver),
    ) -> Step<()> {
        let ended = self.run(command, observer, hear)?;
        match ended.status.success() {
            true => Ok(()),
            false => Err(self.failure(command, &ended).into()),
        }
    }

    /// Runs `command`, whose standard output is no text: `read` gets it. What it says on standard error goes into the log.
    pub(super) fn stream(
        &mut self,
        command: &mut Command,
        read: impl FnOnce(&mut dyn Read) -> Step<()>,
    ) -> Step<()> {
        self.write(&format!("$ {}", shown(command)))?;
        let mut program = start(command)?;
        let (lines, heard) = mpsc::channel();
        let (out, err) = program.pipes();
        err.into_iter().for_each(|err| pass_lines(Box::new(err), lines.clone()));
        drop(lines);
        // On an error the program is ended by being dropped.
        out.map_or(Ok(()), |mut out| read(&mut out))?;
        let status = program.wait().map_err(io_of(command))?;
        let said: Vec<String> = heard.iter().collect();
        said.iter().try_for_each(|line| self.write(line))?;
        self.write(&format!("{status}"))?;
        match status.success() {
            true => Ok(()),
            false => Err(self.failure(command, &Ended { status, said }).into()),
        }
    }

    /// The error of a program that did not succeed.
    pub(super) fn failure(&self, command: &Command, ended: &Ended) -> Error {
        let name = command.get_program().to_string_lossy().into_owned();
        let telling = |line: &&String| {
            let lower = line.to_lowercase();
            ["error", "fail", "cannot", "could not", "invalid", "not found"].iter().any(|w| lower.contains(w))
        };
        let line = ended.said.iter().rev().find(telling).or(ended.said.last());
        let last = line.map_or(String::new(), |line| format!(": {}", line.trim()));
        let reason = format!("{name} ended with {}{last}; this is its log", ended.status);
        Error::unsupported(&self.path, reason)
    }

    fn write(&mut self, line: &str) -> Step<()> {
        writeln!(self.file, "{line}").map_err(|e| Error::io(&self.path, e).into())
    }
}

fn boxed<R: Read + Send + 'static>(from: R) -> Box<dyn Read + Send> {
    Box::new(from)
}

fn start(command: &mut Command) -> Step<Running> {
    Running::start(command).map_err(|e| io_of(command)(e).into())
}

fn io_of(command: &Command) -> impl Fn(io::Error) -> Error + use<> {
    let name = PathBuf::from(command.get_program());
    move |e| Error::io(&name, e)
}

/// Sends lines until there are no more or nobody listens.
fn pass_lines(from: Box<dyn Read + Send>, to: Sender<String>) {
    std::thread::spawn(move || {
        let mut from = BufReader::new(from);
        let mut line = Vec::new();
        // Bars end their lines with a carriage return.
        while from.read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
            let text = String::from_utf8_lossy(&line).trim_end().to_owned();
            if to.send(text).is_err() {
                return;
            }
            line.clear();
        }
    });
}

/// A command as it could be typed, for the log.
fn shown(command: &Command) -> String {
    let words = std::iter::once(command.get_program()).chain(command.get_args());
    let short = |word: std::borrow::Cow<str>| match word.char_indices().nth(200) {
        Some((end, _)) => format!("{}…", &word[..end]).replace('\n', " "),
        None => word.replace('\n', " "),
    };
    words.map(|word| short(word.to_string_lossy())).collect::<Vec<_>>().join(" ")
}
