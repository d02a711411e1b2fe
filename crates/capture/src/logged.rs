//! Runs other programs. Each line of their output goes to a log and to a progress callback.

use super::step::{Step, tell};
use std::fs::{File, TryLockError};
use std::io::{self, BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError, SyncSender};
use std::thread::Builder;
use std::time::{Duration, Instant};
use trisplat_scene::{
    Error,
    process::running::Running,
    report::{StageEvent, StageObserver},
};

/// Interval between checks for a stop request.
const TICK: Duration = Duration::from_millis(100);
/// Longest wait for a program left over from a killed run.
const PATIENCE: Duration = Duration::from_secs(5);
/// Lines kept for error messages.
const KEPT: usize = 40;
/// Bytes of a line; a longer one is passed on in pieces, as a program may print one without end.
const LONGEST: u64 = 1 << 13;
/// Lines that wait to be heard; then the program waits.
const WAITING: usize = 64;

/// The log file of a capture.
#[derive(Debug)]
pub(super) struct Log {
    pub(super) path: PathBuf,
    file: File,
    /// Locked, and the standard input of every program: one that runs on when this process is killed keeps the lock.
    lock: File,
}

/// How a program ended.
#[derive(Debug)]
pub(super) struct Ended {
    pub(super) status: ExitStatus,
    /// Its last lines of output.
    pub(super) said: Vec<String>,
}

impl Log {
    /// Opens the log at `path` for appending.
    ///
    /// Errors: a program that another run started for this log is still running.
    pub(super) fn open(path: &Path) -> Step<Self> {
        let lock = locked(&path.with_extension("lock"))?;
        let file = File::options().create(true).append(true).open(path).map_err(|e| Error::io(path, e))?;
        Ok(Self { path: path.to_owned(), file, lock })
    }

    /// Runs `command` to its end, or until `observer` stops it. `hear` gets each line of standard output and error.
    pub(super) fn run(
        &mut self,
        command: &mut Command,
        observer: StageObserver<'_>,
        mut hear: impl FnMut(&str, StageObserver<'_>) -> Step<()>,
    ) -> Step<Ended> {
        self.write(&format!("$ {}", shown(command)))?;
        let mut program = self.start(command)?;
        let (lines, heard) = mpsc::sync_channel(WAITING);
        let (out, err) = program.pipes();
        let mut readers = [out.map(boxed), err.map(boxed)].into_iter().flatten();
        readers.try_for_each(|from| pass_lines(from, lines.clone())).map_err(io_of(command))?;
        drop(lines);
        let mut said = Vec::new();
        loop {
            let told = match heard.recv_timeout(TICK) {
                Ok(line) => {
                    self.write(&line)?;
                    let told = hear(&line, observer);
                    keep(&mut said, line);
                    told
                }
                // A grandchild may keep the pipes open after the program has ended.
                Err(RecvTimeoutError::Timeout) if program.has_ended().map_err(io_of(command))?.is_some() => {
                    break;
                }
                Err(RecvTimeoutError::Timeout) => tell(observer, StageEvent::Waiting),
                Err(RecvTimeoutError::Disconnected) => break,
            };
            if let Err(halt) = told {
                program.stop();
                self.write("stopped")?;
                return Err(halt);
            }
        }
        let status = program.wait().map_err(io_of(command))?;
        self.write(&format!("{status}"))?;
        Ok(Ended { status, said })
    }

    /// [`Log::run`], with an error unless the program succeeds.
    pub(super) fn run_well(
        &mut self,
        command: &mut Command,
        observer: StageObserver<'_>,
        hear: impl FnMut(&str, StageObserver<'_>) -> Step<()>,
    ) -> Step<()> {
        let ended = self.run(command, observer, hear)?;
        match ended.status.success() {
            true => Ok(()),
            false => Err(self.failure(command, &ended).into()),
        }
    }

    /// Runs `command` and passes its binary standard output to `read`. Standard error goes to the log.
    pub(super) fn stream(
        &mut self,
        command: &mut Command,
        read: impl FnOnce(&mut dyn Read) -> Step<()>,
    ) -> Step<()> {
        self.write(&format!("$ {}", shown(command)))?;
        let mut program = self.start(command)?;
        let (out, err) = program.pipes();
        let mut log = self.file.try_clone().map_err(|e| Error::io(&self.path, e))?;
        let listener = Builder::new().spawn(move || {
            let mut said = Vec::new();
            err.into_iter().for_each(|err| {
                each_line(err, |line| {
                    keep(&mut said, line);
                    said.last().is_some_and(|line| writeln!(log, "{line}").is_ok())
                });
            });
            said
        });
        let listener = listener.map_err(io_of(command))?;
        // On an error, dropping the program ends it.
        out.map_or(Ok(()), |mut out| read(&mut out))?;
        let status = program.wait().map_err(io_of(command))?;
        // One that panicked has heard nothing.
        let said = listener.join().unwrap_or_default();
        self.write(&format!("{status}"))?;
        match status.success() {
            true => Ok(()),
            false => Err(self.failure(command, &Ended { status, said }).into()),
        }
    }

    /// The error for a failed program.
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

    fn start(&self, command: &mut Command) -> Step<Running> {
        let lock = self.lock.try_clone().map_err(io_of(command))?;
        Running::start(command.stdin(Stdio::from(lock))).map_err(|e| io_of(command)(e).into())
    }

    fn write(&mut self, line: &str) -> Step<()> {
        writeln!(self.file, "{line}").map_err(|e| Error::io(&self.path, e).into())
    }
}

fn boxed<R: Read + Send + 'static>(from: R) -> Box<dyn Read + Send> {
    Box::new(from)
}

/// The file at `path`, which is made if need be, with its lock.
fn locked(path: &Path) -> Step<File> {
    let io = |e| Error::io(path, e);
    let file = File::options().read(true).append(true).create(true).open(path).map_err(io)?;
    let began = Instant::now();
    loop {
        match file.try_lock() {
            Err(TryLockError::WouldBlock) if began.elapsed() < PATIENCE => std::thread::sleep(TICK),
            Err(TryLockError::WouldBlock) => {
                let why =
                    "a program that an earlier run has started still works here; wait for it, or end it";
                return Err(io(io::Error::new(io::ErrorKind::ResourceBusy, why)).into());
            }
            // Without locks nothing is worse than before.
            Ok(()) | Err(TryLockError::Error(_)) => return Ok(file),
        }
    }
}

fn io_of(command: &Command) -> impl Fn(io::Error) -> Error + use<> {
    let name = PathBuf::from(command.get_program());
    move |e| Error::io(&name, e)
}

/// Sends lines until the end of the stream, or until the receiver is gone.
///
/// Errors: the system starts no thread.
fn pass_lines(from: Box<dyn Read + Send>, to: SyncSender<String>) -> io::Result<()> {
    Builder::new().spawn(move || each_line(from, |line| to.send(line).is_ok())).map(drop)
}

/// Calls `take` with every line, until the end of the stream or until it returns false.
fn each_line(from: impl Read, mut take: impl FnMut(String) -> bool) {
    let mut from = BufReader::new(from);
    let mut line = Vec::new();
    // Progress bars end their lines with a carriage return.
    while from.by_ref().take(LONGEST).read_until(b'\n', &mut line).is_ok_and(|read| read > 0) {
        if !take(String::from_utf8_lossy(&line).trim_end().to_owned()) {
            return;
        }
        line.clear();
    }
}

/// Appends a line and drops the oldest above the limit.
fn keep(said: &mut Vec<String>, line: String) {
    said.push(line);
    if said.len() > 2 * KEPT {
        said.drain(..KEPT);
    }
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

#[cfg(all(test, unix))]
mod tests {
    use super::super::step::Halt;
    use super::*;
    use std::ops::ControlFlow::Continue;

    fn printing(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    }

    #[test]
    fn a_line_without_end_is_heard_in_pieces() {
        let folder = tempfile::tempdir().unwrap();
        let mut log = Log::open(&folder.path().join("a.log")).unwrap();
        let bytes = 4_000_000;
        let long = format!("head -c {bytes} /dev/zero | tr '\\0' x");
        let (mut longest, mut sum) = (0, 0);
        let ended = log.run(&mut printing(&long), &mut |_| Continue(()), |line, _| {
            (longest, sum) = (longest.max(line.len()), sum + line.len());
            Ok(())
        });
        assert!(ended.unwrap().status.success());
        assert!(longest <= LONGEST as usize && sum == bytes, "{longest}, {sum}");

        // What a program says while its pictures are read.
        let read = |from: &mut dyn Read| {
            drop(io::copy(from, &mut io::sink()));
            Ok(())
        };
        let failed = log.stream(&mut printing(&format!("({long}; echo; echo it failed) >&2; exit 1")), read);
        let Err(Halt::Failed(error)) = failed else { panic!("it succeeded") };
        assert!(error.to_string().contains(": it failed; this is its log"), "{error}");
        assert!(std::fs::metadata(&log.path).unwrap().len() > 2 * bytes as u64);
    }
}
