//! The error type, grouped by who must act.

use std::path::{Path, PathBuf};

/// The result of every fallible function of the library.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why something could not be done, grouped by who can fix it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An error of the operating system: permissions, a full disk, a missing file.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A file violates its format.
    #[error("{}: {at}: {reason}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The place in the file: "header line 4", "face 12", "byte 0x40".
        at: String,
        /// The fault and the remedy.
        reason: String,
    },
    /// The file is valid but has unsupported content; `reason` ends with the remedy.
    #[error("{}: {reason}", path.display())]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The unsupported content and the remedy.
        reason: String,
    },
    /// An option or argument has an unusable value.
    #[error("{option} is {value}: expected {wants}")]
    Invalid {
        /// The field of the option (`max_triangles`), or another name of the value; the command line shows
        /// the flag.
        option: String,
        /// The value given.
        value: String,
        /// What would be accepted.
        wants: String,
    },
    /// More data than a format or a machine can hold.
    #[error("{what} is {bytes} bytes, the limit is {limit}: {remedy}")]
    TooLarge {
        /// What is too large.
        what: String,
        /// Its size.
        bytes: u64,
        /// The largest size that works.
        limit: u64,
        /// What to do instead.
        remedy: String,
    },
    /// The result exists, but another output is missing; the text names it.
    #[error("{0}")]
    Incomplete(String),
    /// A run was stopped before it had a result.
    #[error("{what}")]
    Stopped {
        /// Where it was stopped, and how to go on.
        what: String,
    },
    /// A file exceeds a limit: see [`Limits`](crate::limits::Limits).
    #[error("{place}: {value} {what}, the limit is {limit}; if that is right, give `limit` {key}={value}")]
    Limit {
        /// The file, and the place in it.
        place: String,
        /// The quantity that is too large: "triangles".
        what: &'static str,
        /// The limit's key.
        key: &'static str,
        /// How much there is.
        value: u64,
        /// How much there may be.
        limit: u64,
    },
    /// There is not enough memory for a large array.
    #[error("{place}: there is no memory for {bytes} bytes; end other programs, or give a smaller file")]
    Memory {
        /// The file, and the part of it.
        place: String,
        /// Size of the array.
        bytes: u64,
    },
    /// The graphics device or its driver cannot do the work.
    #[error("gpu: {0}")]
    Gpu(String),
    /// A training on a graphics card ended early.
    #[error("{error}; {remedy}")]
    Card {
        /// What went wrong.
        error: Box<Error>,
        /// How to continue.
        remedy: String,
    },
}

impl Error {
    /// Wraps an error of the operating system about `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_owned(), source }
    }

    /// Wraps an error of the operating system about an input, which may not exist.
    pub fn unread(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        match source.kind() {
            std::io::ErrorKind::NotFound => {
                Self::io(path, std::io::Error::new(source.kind(), "does not exist"))
            }
            _ => Self::io(path, source),
        }
    }

    /// Wraps an error of the operating system about a temporary file.
    pub fn temporary(source: std::io::Error) -> Self {
        let variable = if cfg!(windows) { "TEMP" } else { "TMPDIR" };
        let why = format!(
            "no temporary file can be written here ({source}); make room, or name another folder with the variable {variable}"
        );
        Self::io(std::env::temp_dir(), std::io::Error::new(source.kind(), why))
    }

    /// A broken file: `at` is the place, `reason` the fault.
    pub fn malformed(path: impl AsRef<Path>, at: impl Into<String>, reason: impl Into<String>) -> Self {
        Self::Malformed { path: path.as_ref().to_owned(), at: at.into(), reason: reason.into() }
    }

    /// A valid file that is not supported; `reason` ends with the remedy.
    pub fn unsupported(path: impl AsRef<Path>, reason: impl Into<String>) -> Self {
        Self::Unsupported { path: path.as_ref().to_owned(), reason: reason.into() }
    }

    /// An unusable value of `option`.
    pub fn invalid(option: impl Into<String>, value: impl ToString, wants: impl Into<String>) -> Self {
        Self::Invalid { option: option.into(), value: value.to_string(), wants: wants.into() }
    }
}
