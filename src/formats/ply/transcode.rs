//! Ascii, big-endian and ragged rows, rewritten as fixed-stride little-endian ones.
//!
//! Nothing is allocated on the word of the header: memory grows with the rows really read.

use super::header::{Element, Encoding, Kind, Scalar};
use super::table::is_corner_list;
use crate::error::{Error, Result};
use crate::formats::{Source, not_a_triangle};
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};

/// What came of the rows of one element.
pub(super) struct Rows {
    /// All single numbers and the corner list; empty when the element was only skipped.
    pub(super) bytes: Vec<u8>,
    /// The byte after the last row.
    pub(super) end: u64,
}

/// Reads the rows of `element`, which start at byte `at`; `keep` says whether they are wanted.
pub(super) fn rows(
    source: &Source,
    encoding: Encoding,
    element: &Element,
    at: u64,
    keep: bool,
) -> Result<Rows> {
    let mut out = Rows { bytes: Vec::new(), end: at };
    // Rows without properties take no bytes, so any number of them may be promised.
    if element.properties.is_empty() {
        return Ok(out);
    }
    let mut file = &source.file;
    file.seek(SeekFrom::Start(at)).map_err(|e| Error::io(&source.path, e))?;
    let mut input = Input { reader: BufReader::with_capacity(1 << 16, file), encoding, at, len: source.len };
    for row in 0..element.rows {
        input.row(element, keep, &mut out.bytes).map_err(|fault| match fault {
            Fault::Io(e) => Error::io(&source.path, e),
            Fault::Text(reason) => Error::malformed(&source.path, format!("{} {row}", element.name), reason),
            Fault::End => Error::malformed(
                &source.path,
                format!("{} {row}", element.name),
                format!("the file ends here, but promises {} rows: it was cut short", element.rows),
            ),
        })?;
    }
    out.end = input.at;
    Ok(out)
}

enum Fault {
    Io(std::io::Error),
    End,
    Text(String),
}

type Step<T> = std::result::Result<T, Fault>;

impl From<std::io::Error> for Fault {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            std::io::ErrorKind::UnexpectedEof => Fault::End,
            _ => Fault::Io(error),
        }
    }
}

struct Input<'a> {
    reader: BufReader<&'a std::fs::File>,
    encoding: Encoding,
    /// Byte of the file that comes next.
    at: u64,
    len: u64,
}

impl Input<'_> {
    fn row(&mut self, element: &Element, keep: bool, out: &mut Vec<u8>) -> Step<()> {
        for property in &element.properties {
            match property.kind {
                Kind::Scalar(scalar) => {
                    let number = self.number(scalar)?;
                    if keep {
                        out.extend_from_slice(&number[..scalar.size()]);
                    }
                }
                Kind::List { count, item } => {
                    let number = self.number(count)?;
                    let corners = keep && is_corner_list(&property.name);
                    let length = integer(number, count);
                    if corners && length != 3 {
                        return Err(Fault::Text(not_a_triangle(length)));
                    }
                    if corners {
                        out.extend_from_slice(&number[..count.size()]);
                    }
                    self.items(length, item, corners.then_some(&mut *out))?;
                }
            }
        }
        Ok(())
    }

    /// The items of a list, appended to `out` or skipped.
    fn items(&mut self, length: i64, item: Scalar, mut out: Option<&mut Vec<u8>>) -> Step<()> {
        let length = u64::try_from(length).map_err(|_| Fault::Text(format!("a list of {length} numbers")))?;
        if out.is_none() && self.encoding != Encoding::Ascii {
            return self.skip(length * item.size() as u64);
        }
        for _ in 0..length {
            let number = self.number(item)?;
            if let Some(out) = &mut out {
                out.extend_from_slice(&number[..item.size()]);
            }
        }
        Ok(())
    }

    /// The next number as little-endian bytes.
    fn number(&mut self, scalar: Scalar) -> Step<[u8; 8]> {
        if self.encoding == Encoding::Ascii {
            return self.ascii(scalar);
        }
        let mut bytes = [0; 8];
        let used = &mut bytes[..scalar.size()];
        self.reader.read_exact(used)?;
        self.at += used.len() as u64;
        if self.encoding == Encoding::Big {
            used.reverse();
        }
        Ok(bytes)
    }

    fn skip(&mut self, bytes: u64) -> Step<()> {
        if bytes > self.len.saturating_sub(self.at) {
            return Err(Fault::End);
        }
        self.at += bytes;
        // What is left of a file is below i64::MAX.
        Ok(self.reader.seek_relative(bytes as i64)?)
    }

    fn ascii(&mut self, scalar: Scalar) -> Step<[u8; 8]> {
        let mut buffer = [0; 64];
        let word = self.word(&mut buffer)?;
        let text = std::str::from_utf8(word).unwrap_or("?");
        let bad = || Fault::Text(format!("{text:?} is not a number of its type ({scalar:?})"));
        parse(text, scalar).ok_or_else(bad)
    }

    /// The next word between white space.
    fn word<'b>(&mut self, buffer: &'b mut [u8; 64]) -> Step<&'b [u8]> {
        let mut length = 0;
        loop {
            let chunk = self.reader.fill_buf()?;
            if chunk.is_empty() {
                return if length > 0 { Ok(&buffer[..length]) } else { Err(Fault::End) };
            }
            let mut used = 0;
            for &byte in chunk {
                used += 1;
                if !byte.is_ascii_whitespace() {
                    let slot = buffer
                        .get_mut(length)
                        .ok_or_else(|| Fault::Text("a number of more than 64 characters".into()))?;
                    *slot = byte;
                    length += 1;
                } else if length > 0 {
                    self.at += used as u64;
                    self.reader.consume(used);
                    return Ok(&buffer[..length]);
                }
            }
            self.at += used as u64;
            self.reader.consume(used);
        }
    }
}

fn parse(text: &str, scalar: Scalar) -> Option<[u8; 8]> {
    fn wide<const N: usize>(bytes: [u8; N]) -> [u8; 8] {
        let mut out = [0; 8];
        out[..N].copy_from_slice(&bytes);
        out
    }
    Some(match scalar {
        Scalar::I8 => wide(text.parse::<i8>().ok()?.to_le_bytes()),
        Scalar::U8 => wide(text.parse::<u8>().ok()?.to_le_bytes()),
        Scalar::I16 => wide(text.parse::<i16>().ok()?.to_le_bytes()),
        Scalar::U16 => wide(text.parse::<u16>().ok()?.to_le_bytes()),
        Scalar::I32 => wide(text.parse::<i32>().ok()?.to_le_bytes()),
        Scalar::U32 => wide(text.parse::<u32>().ok()?.to_le_bytes()),
        Scalar::F32 => wide(text.parse::<f32>().ok()?.to_le_bytes()),
        Scalar::F64 => wide(text.parse::<f64>().ok()?.to_le_bytes()),
    })
}

/// A list count, from its little-endian bytes.
fn integer(number: [u8; 8], scalar: Scalar) -> i64 {
    super::table::Column { offset: 0, scalar }.int(&number)
}
