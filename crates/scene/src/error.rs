//! The error type, grouped by who must act.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// The result of every fallible function of the library.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// The error of every fallible function, grouped by who can fix it.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// An error of the operating system: permissions, a full disk, a missing file.
    #[error("{}: {source}", display(path))]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The error of the system.
        source: std::io::Error,
    },
    /// A file violates its format.
    #[error("{}: {at}: {reason}", display(path))]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The place in the file: "header line 4", "face 12", "byte 0x40".
        at: String,
        /// The fault and the remedy.
        reason: String,
    },
    /// The file is valid but has unsupported content; `reason` ends with the remedy.
    #[error("{}: {reason}", display(path))]
    Unsupported {
        /// The file.
        path: PathBuf,
        /// The unsupported content and the remedy.
        reason: String,
    },
    /// An option or argument has an unusable value.
    #[error("{option} is {value}: expected {wants}")]
    Invalid {
        /// The field of the option (`max_triangles`), or another name of the value; the command
        /// line shows the flag.
        option: String,
        /// The value given.
        value: String,
        /// The accepted values.
        wants: String,
    },
    /// Data in memory, or all options together, are unusable; the sentence says why.
    #[error("{0}")]
    InvalidData(String),
    /// The region to keep holds nothing of the scene, or cannot be determined.
    #[error("crop is {region}: expected {wants}")]
    EmptyRegion {
        /// The region, as in the option `crop`.
        region: String,
        /// The accepted values.
        wants: String,
    },
    /// Cameras see no connected surface in the scene.
    #[error(
        "no surface was found: the cameras see too few triangles; lower `min_component` or `min_views`, or give a data set whose photos show the scene"
    )]
    EmptySurface,
    /// The photos do not show the scene.
    #[error("dataset is {fault}: expected {wants}")]
    ForeignPhotos {
        /// The fault of the photos.
        fault: String,
        /// The accepted values.
        wants: String,
    },
    /// The name of an output tells no format.
    #[error(
        "output is {}: expected a name ending in .glb, .gltf, .obj, .ply, .usdz, .html or .tileset.json, or `format`",
        path.display()
    )]
    UnknownEnding {
        /// The output.
        path: PathBuf,
    },
    /// Some photos are missing or damaged.
    #[error("{}: {at}: {reason}, or skip them with `skip_broken`", display(path))]
    BrokenPhotos {
        /// The list or folder of the photos.
        path: PathBuf,
        /// The first of them.
        at: String,
        /// The fault and the remedy.
        reason: String,
    },
    /// The program is built without an optional feature.
    #[error("this build lacks the feature `{0}`; rebuild with --features {0}")]
    MissingFeature(&'static str),
    /// More data than a format or a machine can hold.
    #[error("{what} is {bytes} bytes, the limit is {limit}: {remedy}")]
    TooLarge {
        /// The data that are too large.
        what: String,
        /// Its size.
        bytes: u64,
        /// The largest size that works.
        limit: u64,
        /// The remedy.
        remedy: String,
    },
    /// The result exists, but another output is missing; the text names it.
    #[error("{0}")]
    Incomplete(String),
    /// A run was stopped before it had a result.
    #[error("{what}")]
    Stopped {
        /// The place at which it was stopped, and how to go on.
        what: String,
    },
    /// A file exceeds a limit: see [`Limits`](crate::limits::Limits).
    #[error(
        "{place}: {value} {what}, the limit is {limit}; if that is right, give `limit` {key}={value}"
    )]
    Limit {
        /// The file, and the place in it.
        place: String,
        /// The quantity that is too large: "triangles".
        what: &'static str,
        /// The limit's key.
        key: &'static str,
        /// The amount in the file.
        value: u64,
        /// The largest amount allowed.
        limit: u64,
    },
    /// There is not enough memory for a large array.
    #[error(
        "{place}: there is no memory for {bytes} bytes; end other programs, or give a smaller file"
    )]
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
        /// The fault.
        error: Box<Error>,
        /// The remedy.
        remedy: String,
    },
}

impl Error {
    /// The field of the option that begins the message.
    pub fn option(&self) -> Option<&str> {
        match self {
            Self::Invalid { option, .. } => Some(option),
            Self::EmptyRegion { .. } => Some("crop"),
            Self::ForeignPhotos { .. } => Some("dataset"),
            Self::UnknownEnding { .. } => Some("output"),
            _ => None,
        }
    }

    /// The option that the last clause of the message offers as a way out, and that clause.
    pub fn way_out(&self) -> Option<(&'static str, &'static str)> {
        match self {
            Self::UnknownEnding { .. } => Some(("format", ", or `format`")),
            Self::BrokenPhotos { .. } => Some(("skip_broken", ", or skip them with `skip_broken`")),
            _ => None,
        }
    }

    /// Wraps an error of the operating system about `path`.
    pub fn io(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        Self::Io { path: path.as_ref().to_owned(), source }
    }

    /// Wraps an error of the operating system about an input, which may not exist.
    pub fn unread(path: impl AsRef<Path>, source: std::io::Error) -> Self {
        let path = path.as_ref();
        let is_address = ["http:", "https:"].iter().any(|scheme| path.starts_with(scheme));
        let why = match source.kind() {
            std::io::ErrorKind::NotFound if is_address => {
                "is an address; download the file, and give its name"
            }
            std::io::ErrorKind::NotFound => "does not exist",
            _ => return Self::io(path, source),
        };
        Self::io(path, std::io::Error::new(source.kind(), why))
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
    pub fn malformed(
        path: impl AsRef<Path>,
        at: impl Into<String>,
        reason: impl Into<String>,
    ) -> Self {
        let at = in_message(at.into());
        let reason = in_message(reason.into());
        Self::Malformed { path: path.as_ref().to_owned(), at, reason }
    }

    /// Photos of a list or folder that are missing or damaged; the message ends with a way out.
    pub fn broken_photos(path: impl AsRef<Path>, at: impl Into<String>, reason: &str) -> Self {
        let at = in_message(at.into());
        let reason = in_message(reason.to_owned());
        Self::BrokenPhotos { path: path.as_ref().to_owned(), at, reason }
    }

    /// A valid file that is not supported; `reason` ends with the remedy.
    pub fn unsupported(path: impl AsRef<Path>, reason: impl Into<String>) -> Self {
        Self::Unsupported { path: path.as_ref().to_owned(), reason: in_message(reason.into()) }
    }

    /// The same error about `path`, for a file that was made of that one.
    pub fn about(mut self, file: &Path) -> Self {
        match &mut self {
            Self::Io { path, .. }
            | Self::Malformed { path, .. }
            | Self::Unsupported { path, .. } => {
                *path = file.to_owned();
            }
            Self::Limit { place, .. } => *place = file.display().to_string(),
            _ => {}
        }
        self
    }

    /// Unusable data; `sentence` says why.
    pub fn invalid_data(sentence: impl Into<String>) -> Self {
        Self::InvalidData(in_message(sentence.into()))
    }

    /// An unusable value of `option`.
    pub fn invalid(
        option: impl Into<String>,
        value: impl ToString,
        wants: impl Into<String>,
    ) -> Self {
        let value = in_message(value.to_string());
        let wants = in_message(wants.into());
        Self::Invalid { option: option.into(), value, wants }
    }
}

/// A path in a message; the working folder has a name, too.
fn display(path: &Path) -> std::path::Display<'_> {
    if path.as_os_str().is_empty() { Path::new(".").display() } else { path.display() }
}

/// Maximum length of a quotation from a file in a message, characters.
const MAX_EXCERPT: usize = 80;

/// Length of a message up to which it is left as it is, bytes: it holds no more than a few paths.
const UNCUT_MESSAGE_BYTES: usize = 600;
/// Maximum length of a message, characters.
const MAX_MESSAGE: usize = 2000;

/// "5, 17, 230 and 12 more": the first `max` of some names, for a message.
pub fn first_of(names: impl ExactSizeIterator<Item = String>, max: usize) -> String {
    let more = names.len().saturating_sub(max);
    let named = names.take(max).collect::<Vec<_>>().join(", ");
    if more == 0 { named } else { format!("{named} and {more} more") }
}

/// Shorten a quotation from a file for a message.
pub fn excerpt(text: &str) -> String {
    cut(text, MAX_EXCERPT).into_owned()
}

/// Shorten a long message, so that text of a file in it, such as a parser's error, takes little
/// space.
fn in_message(text: String) -> String {
    if text.len() <= UNCUT_MESSAGE_BYTES {
        return text;
    }
    let words: Vec<Cow<str>> = text.split(' ').map(|word| cut(word, MAX_EXCERPT)).collect();
    cut(&words.join(" "), MAX_MESSAGE).into_owned()
}

/// The text with at most `max` characters; the middle of a longer one is left out.
pub fn cut(text: &str, max: usize) -> Cow<'_, str> {
    let count = text.chars().count();
    if count <= max {
        return Cow::Borrowed(text);
    }
    let end = max / 4;
    let chars = || text.chars();
    chars().take(max - end - 1).chain(['…']).chain(chars().skip(count - end)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_says_takes_little_space_in_a_message() {
        assert_eq!(excerpt("abc"), "abc");
        let long = "ü".repeat(10_000);
        assert_eq!(
            (excerpt(&long).chars().count(), excerpt(&long).matches('…').count()),
            (MAX_EXCERPT, 1)
        );
        for text in [long, "a word ".repeat(10_000)] {
            let said = Error::malformed(
                "a.json",
                &text,
                format!("expected a number, not {text:?}, at line 1"),
            );
            let said = said.to_string();
            assert!(
                said.chars().count() < 2 * MAX_MESSAGE + 20 && said.ends_with("at line 1"),
                "{said}"
            );
        }
        let path = "/folder".repeat(60);
        assert!(Error::invalid("output", &path, "another").to_string().contains(&path));
    }
}
