//! Runs other programs. Their output goes to a log file, and line by line to a callback.

use std::fs::{File, TryLockError};
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};
use trisplat_scene::atomic::folder_of;
use trisplat_scene::process::Running;
use trisplat_scene::report::{StageEvent, StageObserver};
use trisplat_scene::{Error, Result};

/// Interval between two looks at the log.
const TICK: Duration = Duration::from_millis(50);
/// Longest wait for a program left over from a killed run.
const PATIENCE: Duration = Duration::from_secs(5);
/// Lines kept for error messages.
const KEPT: usize = 40;
/// Bytes of a line; a longer one is passed on in pieces.
const LONGEST: u64 = 1 << 13;

/// Sends an event. A stop is [`Error::Stopped`].
pub(super) fn tell(observer: StageObserver<'_>, event: StageEvent<'_>) -> Result<()> {
    if observer(event).is_break() { Err(Error::Stopped { what: "stopped".into() }) } else { Ok(()) }
}

/// The log file of a capture.
#[derive(Debug)]
pub(super) struct Log {
    path: PathBuf,
    file: File,
    /// Locked, and the standard input of every program: one that outlives this process keeps the
    /// lock.
    lock: File,
}

/// End of a program.
#[derive(Debug)]
pub(super) struct Ended {
    pub(super) status: ExitStatus,
    /// Its last lines of output.
    pub(super) said: Vec<String>,
}

impl Log {
    /// Opens the log at `path` for appending.
    ///
    /// # Errors
    ///
    /// A program that another run started for this log is still running.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let lock = locked(&path.with_extension("lock"))?;
        let file =
            File::options().create(true).append(true).open(path).map_err(|e| Error::io(path, e))?;
        Ok(Self { path: path.to_owned(), file, lock })
    }

    /// Runs `command` to its end, or until `observer` stops it. `hear` gets each line of its
    /// output.
    pub(super) fn run(
        &mut self,
        command: &mut Command,
        observer: StageObserver<'_>,
        mut hear: impl FnMut(&str, StageObserver<'_>) -> Result<()>,
    ) -> Result<Ended> {
        let io = io_of(command);
        let mut news = self.begin(command)?;
        command.stdout(self.file.try_clone().map_err(&io)?);
        let mut program = self.start(command)?;
        loop {
            let ended = program.has_ended().map_err(&io)?;
            news.hear(ended.is_some(), |line| hear(line, observer))?;
            if let Some(status) = ended {
                return self.ended(status, news.said);
            }
            tell(observer, StageEvent::Waiting)?;
            std::thread::sleep(TICK);
        }
    }

    /// [`Log::run`], with an error unless the program succeeds.
    pub(super) fn run_well(
        &mut self,
        command: &mut Command,
        observer: StageObserver<'_>,
        hear: impl FnMut(&str, StageObserver<'_>) -> Result<()>,
    ) -> Result<()> {
        let ended = self.run(command, observer, hear)?;
        self.succeeded(command, &ended)
    }

    /// Runs `command` and passes its binary standard output to `read`. Standard error goes to the
    /// log.
    pub(super) fn stream(
        &mut self,
        command: &mut Command,
        read: impl FnOnce(&mut dyn Read) -> Result<()>,
    ) -> Result<()> {
        let mut news = self.begin(command)?;
        let mut program = self.start(command.stdout(Stdio::piped()))?;
        program.output().map_or(Ok(()), |mut output| read(&mut output))?;
        let status = program.wait().map_err(io_of(command))?;
        news.hear(true, |_| Ok(()))?;
        let ended = self.ended(status, news.said)?;
        self.succeeded(command, &ended)
    }

    /// The error for a failed program.
    pub(super) fn failure(&self, command: &Command, ended: &Ended) -> Error {
        let name = command.get_program().to_string_lossy().into_owned();
        let telling = |line: &&String| {
            let lower = line.to_lowercase();
            ["error", "fail", "cannot", "could not", "invalid", "not found"]
                .iter()
                .any(|w| lower.contains(w))
        };
        let line = ended.said.iter().rev().find(telling).or(ended.said.last());
        let last = line.map_or(String::new(), |line| format!(": {}", line.trim()));
        let reason = format!("{name} ended with {}{last}; this is its log", ended.status);
        Error::unsupported(&self.path, reason)
    }

    fn succeeded(&self, command: &Command, ended: &Ended) -> Result<()> {
        if ended.status.success() { Ok(()) } else { Err(self.failure(command, ended)) }
    }

    /// Notes a command. Returns what its output will be read from.
    fn begin(&mut self, command: &Command) -> Result<Tail> {
        self.write(&format!("$ {}", shown(command)))?;
        let io = |e| Error::io(&self.path, e);
        let mut file = File::open(&self.path).map_err(io)?;
        file.seek(SeekFrom::End(0)).map_err(io)?;
        Ok(Tail {
            path: self.path.clone(),
            file: BufReader::new(file),
            line: Vec::new(),
            said: Vec::new(),
        })
    }

    fn start(&self, command: &mut Command) -> Result<Running> {
        let io = io_of(command);
        if command.get_current_dir().is_none() {
            command.current_dir(folder_of(&self.path));
        }
        command.stdin(self.lock.try_clone().map_err(&io)?);
        command.stderr(self.file.try_clone().map_err(&io)?);
        Running::start(command).map_err(io)
    }

    fn ended(&mut self, status: ExitStatus, said: Vec<String>) -> Result<Ended> {
        self.write(&format!("{status}"))?;
        Ok(Ended { status, said })
    }

    fn write(&mut self, line: &str) -> Result<()> {
        writeln!(self.file, "{line}").map_err(|e| Error::io(&self.path, e))
    }
}

/// The part of a log that a program writes.
struct Tail {
    path: PathBuf,
    file: BufReader<File>,
    /// The begun line.
    line: Vec<u8>,
    /// The last lines.
    said: Vec<String>,
}

impl Tail {
    /// Passes on what was written since the last call; the begun line too, if the program has
    /// `ended`.
    fn hear(&mut self, ended: bool, mut hear: impl FnMut(&str) -> Result<()>) -> Result<()> {
        loop {
            let room = LONGEST - self.line.len() as u64;
            let read = self.file.by_ref().take(room).read_until(b'\n', &mut self.line);
            let is_over = read.map_err(|e| Error::io(&self.path, e))? == 0;
            if self.line.is_empty() || (is_over && !ended) {
                return Ok(());
            }
            if is_over || self.line.ends_with(b"\n") || self.line.len() as u64 == LONGEST {
                let line = String::from_utf8_lossy(&self.line).trim_end().to_owned();
                self.line.clear();
                hear(&line)?;
                self.said.push(line);
                if self.said.len() > 2 * KEPT {
                    self.said.drain(..KEPT);
                }
            }
        }
    }
}

/// The file at `path`, made if missing, with its lock.
fn locked(path: &Path) -> Result<File> {
    let io = |e| Error::io(path, e);
    let file = File::options().read(true).append(true).create(true).open(path).map_err(io)?;
    let began = Instant::now();
    loop {
        match file.try_lock() {
            Err(TryLockError::WouldBlock) if began.elapsed() < PATIENCE => std::thread::sleep(TICK),
            Err(TryLockError::WouldBlock) => {
                let why = "a program that an earlier run has started still works here; wait for it, or end it";
                return Err(io(io::Error::new(io::ErrorKind::ResourceBusy, why)));
            }
            // Without locks nothing is worse than before.
            Ok(()) | Err(TryLockError::Error(_)) => return Ok(file),
        }
    }
}

/// Start a command of another program. Its paths must be full ones: it runs in a folder of its own,
/// where nothing of the user's is found by its name alone.
pub(super) fn program(path: &Path) -> Command {
    // The system looks for a name without a folder in PATH.
    let is_name = path.components().count() == 1 && path.is_relative();
    let full = if is_name { None } else { full_path(path).ok() };
    let mut command = Command::new(full.as_deref().unwrap_or(path));
    // Without a display, Qt would abort.
    command.env("QT_QPA_PLATFORM", "offscreen");
    command
}

/// Make a path absolute, so that no program takes it for an option or a protocol. Links stay.
pub(super) fn full_path(path: &Path) -> Result<PathBuf> {
    std::path::absolute(path).map_err(|e| Error::io(path, e))
}

/// Return the output of a short command that runs in an empty folder; `None` if the program is
/// missing or fails silently.
pub(super) fn said(command: &mut Command) -> Option<String> {
    let folder = tempfile::tempdir();
    command.current_dir(folder.as_ref().map_or(Path::new("/"), tempfile::TempDir::path));
    let Output { status, stdout, stderr } = command.stdin(Stdio::null()).output().ok()?;
    let text = String::from_utf8_lossy(&[stdout, stderr].concat()).into_owned();
    (status.success() || !text.trim().is_empty()).then_some(text)
}

fn io_of(command: &Command) -> impl Fn(io::Error) -> Error + use<> {
    let name = PathBuf::from(command.get_program());
    move |e| Error::io(&name, e)
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

#[cfg(test)]
#[cfg(unix)]
mod tests {
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
        let mut longest = 0;
        let mut sum = 0;
        let ended = log.run(&mut printing(&long), &mut |_| Continue(()), |line, _| {
            longest = longest.max(line.len());
            sum += line.len();
            Ok(())
        });
        assert!(ended.unwrap().status.success());
        assert!(longest <= LONGEST as usize && sum == bytes, "{longest}, {sum}");

        // Messages of a program while its pictures are read.
        let read = |from: &mut dyn Read| {
            drop(io::copy(from, &mut io::sink()));
            Ok(())
        };
        let failed =
            log.stream(&mut printing(&format!("({long}; echo; echo it failed) >&2; exit 1")), read);
        let error = failed.unwrap_err().to_string();
        assert!(error.contains(": it failed; this is its log"), "{error}");
        assert!(std::fs::metadata(&log.path).unwrap().len() > 2 * bytes as u64);
    }
}
