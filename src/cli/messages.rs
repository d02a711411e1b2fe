//! Lines on standard error and standard output: the only place that prints text from files. Control
//! characters are escaped, so that a name can neither forge a line nor control the terminal.
//!
//! "error" and "warning" are coloured as clap colours its own: on a terminal, unless the
//! environment says otherwise (`NO_COLOR`, `CLICOLOR`, `CLICOLOR_FORCE`, `TERM=dumb`).

use anstyle::{AnsiColor, Style};
use indicatif::HumanCount;
use serde::Serialize;
use std::borrow::Cow;
use std::fmt::Write as _;
use std::io::{self, ErrorKind, Write};
use trisplat_scene::atomic::AtomicFile;
use trisplat_scene::{Error, Result, cut};

/// Maximum length of a line, characters: several paths, or a command with some.
const MAX_LINE: usize = 16_384;

const ERROR: Style = AnsiColor::Red.on_default().bold();
const WARNING: Style = AnsiColor::Yellow.on_default().bold();

/// Prints a line on standard error; a leading "error:" or "warning:" is coloured.
pub fn print(text: &str) {
    // A closed pipe (`2>&1 | head`) must not end the work.
    let _ = writeln!(anstream::stderr(), "{}", styled(&visible(&cut(text, MAX_LINE))));
}

/// Writes a line of a table.
pub fn write(out: &mut dyn Write, text: &str) -> io::Result<()> {
    writeln!(out, "{}", visible(&cut(text, MAX_LINE)))
}

/// `text` with control characters, line breaks and marks of bidirectional text escaped as `\n` or
/// `\u{1b}`.
pub fn visible(text: &str) -> Cow<'_, str> {
    if !text.contains(is_hidden) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        // Writing to a string does not fail.
        let _ = if is_hidden(c) {
            write!(shown, "{}", c.escape_default())
        } else {
            shown.write_char(c)
        };
    }
    Cow::Owned(shown)
}

/// Control characters (Unicode's category Cc), line and paragraph separators, and the marks of
/// bidirectional text.
fn is_hidden(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}' | '\u{200e}' | '\u{200f}' | '\u{61c}')
}

/// The line with its colours, for any output.
fn styled(text: &str) -> String {
    for (word, style) in [("error:", ERROR), ("warning:", WARNING)] {
        if let Some(rest) = text.strip_prefix(word) {
            return format!("{style}{word}{style:#}{rest}");
        }
    }
    text.to_owned()
}

// ---- Numbers as a person reads them -------------------------------------------------------------

/// 1234567 as "1,234,567", to be padded like any text.
pub(super) fn thousands(number: u64) -> String {
    HumanCount(number).to_string()
}

/// The same with a noun: "1 triangle", "1,234 triangles".
pub(super) fn many(number: u64, noun: &str) -> String {
    let text = thousands(number);
    let end = if number == 1 { "" } else { "s" };
    format!("{text} {noun}{end}")
}

// ---- JSON, as commands print and write it, and standard output ----------------------------------

/// Writes `value` as indented JSON and a final newline.
pub fn print_json(value: &impl Serialize, out: &mut dyn Write) -> io::Result<()> {
    serde_json::to_writer_pretty(&mut *out, value)?;
    writeln!(out)
}

/// Writes `value` as JSON into a file that was started.
pub fn save_json(value: &impl Serialize, mut file: AtomicFile) -> Result<()> {
    print_json(value, &mut file).map_err(|e| Error::io(file.path(), e))?;
    file.commit().map(drop)
}

/// Standard output that discards text once its reader is gone.
#[derive(Debug, Default)]
pub(super) struct Stdout;

impl Write for Stdout {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match io::stdout().write(bytes) {
            Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(bytes.len()),
            written => written,
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match io::stdout().flush() {
            Err(e) if e.kind() == ErrorKind::BrokenPipe => Ok(()),
            flushed => flushed,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_would_reach_the_terminal_is_shown() {
        assert_eq!(visible("größe 写真.jpg, 60% \\n"), "größe 写真.jpg, 60% \\n");
        assert_eq!(visible("a\nerror: b\r\t\0"), "a\\nerror: b\\r\\t\\u{0}");
        assert_eq!(visible("\u{1b}[31m\u{9b}2J\u{7f}"), "\\u{1b}[31m\\u{9b}2J\\u{7f}");
        assert_eq!(visible("gpj.\u{202e}exe\u{2028}"), "gpj.\\u{202e}exe\\u{2028}");
        let mut out = Vec::new();
        write(&mut out, "photo\nerror: forged").expect("memory");
        assert_eq!(out, b"photo\\nerror: forged\n");
    }

    #[test]
    fn the_first_word_is_coloured_and_nothing_else() {
        assert_eq!(
            styled("error: a warning: b"),
            "\u{1b}[1m\u{1b}[31merror:\u{1b}[0m a warning: b"
        );
        assert_eq!(styled("warning: a"), "\u{1b}[1m\u{1b}[33mwarning:\u{1b}[0m a");
        assert_eq!(styled("wrote error: x"), "wrote error: x");
    }
}
