//! A text file line by line, with line numbers for messages.

use super::source::Source;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek};
use std::path::Path;
use std::str::FromStr;
use trisplat_scene::{Error, Result, input::BYTE_ORDER_MARK};

/// Lines of meshes are far shorter. A longer line means a broken file, and its memory is limited to this.
const LONGEST: u64 = 1 << 16;

pub(super) struct Lines<'a> {
    path: &'a Path,
    reader: BufReader<&'a File>,
    line: Vec<u8>,
    number: u64,
}

impl<'a> Lines<'a> {
    /// Before the first line.
    pub(super) fn new(source: &'a Source) -> Result<Self> {
        let mut file = &*source.file;
        file.rewind().map_err(|e| Error::io(&source.path, e))?;
        let reader = BufReader::with_capacity(1 << 18, file);
        Ok(Self { path: &source.path, reader, line: Vec::new(), number: 0 })
    }

    /// Moves on to the next line; false at the end of the file.
    pub(super) fn advance(&mut self) -> Result<bool> {
        self.line.clear();
        let read = (&mut self.reader).take(LONGEST).read_until(b'\n', &mut self.line);
        self.number += 1;
        let length = read.map_err(|e| Error::io(self.path, e))? as u64;
        if length == LONGEST && self.line.last() != Some(&b'\n') {
            return Err(self.error("is longer than 64 KiB: not a mesh, or a broken one"));
        }
        if self.number == 1 && self.line.starts_with(BYTE_ORDER_MARK) {
            self.line.drain(..BYTE_ORDER_MARK.len());
        }
        if std::str::from_utf8(&self.line).is_err() {
            self.line = String::from_utf8_lossy(&self.line).into_owned().into_bytes();
        }
        Ok(length > 0)
    }

    /// Moves on to the next line with content other than white space and comments.
    pub(super) fn advance_to_text(&mut self) -> Result<bool> {
        while self.advance()? {
            if self.words().next().is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Counted from 1.
    pub(super) fn line_number(&self) -> u64 {
        self.number
    }

    /// The trimmed line.
    pub(super) fn text(&self) -> &str {
        std::str::from_utf8(&self.line).unwrap_or_default().trim()
    }

    /// The words of the line up to a `#`.
    pub(super) fn words(&self) -> impl Iterator<Item = &str> {
        let text = self.text();
        text.split('#').next().unwrap_or_default().split_ascii_whitespace()
    }

    /// The text after the first word, including inner spaces.
    pub(super) fn rest(&self) -> &str {
        self.text().split_once(char::is_whitespace).map_or("", |(_, rest)| rest.trim())
    }

    /// Something wrong in this line.
    pub(super) fn error(&self, reason: impl Into<String>) -> Error {
        Error::malformed(self.path, format!("line {}", self.number), reason)
    }
}

/// A word as a number, or a message about it.
pub(super) fn number<T: FromStr>(word: &str) -> std::result::Result<T, String> {
    word.parse().map_err(|_| format!("{:?} is not a number", clip(word)))
}

/// A quotation short enough for an error message.
pub(super) fn clip(text: &str) -> String {
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}
