//! Rows in ascii, big-endian or of varying length, rewritten as little-endian rows of a fixed
//! stride.
//!
//! Memory grows with the rows read, not with the numbers in the header.

use super::header::{Column, Element, Encoding, PropertyType, Scalar};
use crate::Source;
use crate::faces::{MAX_CORNERS, check_corners, not_a_triangle};
use crate::lines::number;
use std::io::{self, BufReader, ErrorKind, Read, Seek, SeekFrom};
use trisplat_scene::{Error, Result};

/// Names of the list of texture coordinates of a face's corners.
const UV_LISTS: [&str; 2] = ["texcoord", "texcoords"];

/// Part of an element's rows that is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RowSelection {
    /// Nothing, except the end of the rows.
    Nothing,
    /// All single numbers, and faces with three corners: any other face is an error.
    Triangles,
    /// All single numbers, and faces with any number of corners.
    Polygons,
}

/// The rewritten rows of one element.
#[derive(Debug, Default)]
pub(super) struct Transcoded {
    /// All single numbers and the first three corners; empty when the element was only skipped.
    pub(super) bytes: Vec<u8>,
    /// The faces with more than three corners, with all of them.
    pub(super) polygons: Vec<(usize, Vec<i64>)>,
    /// The numbers of all lists of texture coordinates.
    pub(super) uv_numbers: Vec<f32>,
    /// End of each row's numbers in `uv_numbers`; empty without such lists.
    pub(super) uv_ends: Vec<usize>,
    /// The byte after the last row.
    pub(super) end: u64,
}

/// Reads the rows of `element`, which start at byte `at`.
pub(super) fn rows(
    source: &Source,
    encoding: Encoding,
    element: &Element,
    at: u64,
    selection: RowSelection,
) -> Result<Transcoded> {
    let mut out = Transcoded { end: at, ..Transcoded::default() };
    // Rows without properties take no bytes, so a header may contain any number of them.
    if element.properties.is_empty() {
        return Ok(out);
    }
    let mut file = &*source.file;
    file.seek(SeekFrom::Start(at)).map_err(|e| Error::io(&source.path, e))?;
    let reader = BufReader::with_capacity(1 << 16, file);
    let mut input = Input { reader, encoding, at, len: source.len, word: Vec::new() };
    for row in 0..element.rows {
        input.row(element, row as usize, selection, &mut out).map_err(|fault| {
            let reason = match fault.kind() {
                ErrorKind::InvalidData => fault.to_string(),
                ErrorKind::UnexpectedEof => {
                    format!(
                        "the file ends here, but promises {} rows: it was cut short",
                        element.rows
                    )
                }
                _ => return Error::io(&source.path, fault),
            };
            Error::malformed(&source.path, format!("{} {row}", element.name), reason)
        })?;
    }
    out.end = input.at;
    Ok(out)
}

/// The error of a fault in a row.
fn fault(reason: impl Into<String>) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, reason.into())
}

struct Input<'a> {
    reader: BufReader<&'a std::fs::File>,
    encoding: Encoding,
    /// Next byte of the file.
    at: u64,
    len: u64,
    /// The last word of ascii.
    word: Vec<u8>,
}

impl Input<'_> {
    fn row(
        &mut self,
        element: &Element,
        row: usize,
        selection: RowSelection,
        out: &mut Transcoded,
    ) -> io::Result<()> {
        for property in &element.properties {
            match property.kind {
                PropertyType::Scalar(scalar) => {
                    let number = self.number(scalar)?;
                    if selection != RowSelection::Nothing {
                        out.bytes.extend_from_slice(&number[..scalar.size()]);
                    }
                }
                PropertyType::List { count, item }
                    if selection != RowSelection::Nothing && property.is_corner_list() =>
                {
                    self.corners(count, item, row, selection, out)?;
                }
                PropertyType::List { count, item }
                    if selection == RowSelection::Polygons
                        && UV_LISTS.contains(&property.name.as_str()) =>
                {
                    let length = integer(self.number(count)?, count);
                    if !(0..=2 * MAX_CORNERS as i64).contains(&length) {
                        return Err(fault(format!("a list of {length} texture coordinates")));
                    }
                    for _ in 0..length {
                        let number = self.number(item)?;
                        out.uv_numbers.push(Column { offset: 0, scalar: item }.f32(&number));
                    }
                    out.uv_ends.push(out.uv_numbers.len());
                }
                PropertyType::List { count, item } => {
                    let length = self.number(count)?;
                    self.skip_list(integer(length, count), item)?;
                }
            }
        }
        Ok(())
    }

    /// A face's corners: three go into its row, and all of a polygon into `polygons` too.
    fn corners(
        &mut self,
        count: Scalar,
        item: Scalar,
        row: usize,
        selection: RowSelection,
        out: &mut Transcoded,
    ) -> io::Result<()> {
        let length = integer(self.number(count)?, count);
        if selection == RowSelection::Triangles && length != 3 {
            return Err(fault(not_a_triangle(length)));
        }
        let length = check_corners(length).map_err(fault)?;
        // Three, in any integer type.
        out.bytes.extend_from_slice(&3u64.to_le_bytes()[..count.size()]);
        let mut corners = Vec::new();
        for corner in 0..length {
            let number = self.number(item)?;
            if corner < 3 {
                out.bytes.extend_from_slice(&number[..item.size()]);
            }
            if length > 3 {
                corners.push(integer(number, item));
            }
        }
        if length > 3 {
            out.polygons.push((row, corners));
        }
        Ok(())
    }

    fn skip_list(&mut self, length: i64, item: Scalar) -> io::Result<()> {
        let length =
            u64::try_from(length).map_err(|_| fault(format!("a list of {length} numbers")))?;
        if self.encoding != Encoding::Ascii {
            return self.skip(length * item.size() as u64);
        }
        (0..length).try_for_each(|_| self.number(item).map(drop))
    }

    /// The next number as little-endian bytes.
    fn number(&mut self, scalar: Scalar) -> io::Result<[u8; 8]> {
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

    fn skip(&mut self, bytes: u64) -> io::Result<()> {
        if bytes > self.len.saturating_sub(self.at) {
            return Err(ErrorKind::UnexpectedEof.into());
        }
        self.at += bytes;
        // The rest of a file is below i64::MAX.
        self.reader.seek_relative(bytes as i64)
    }

    fn ascii(&mut self, scalar: Scalar) -> io::Result<[u8; 8]> {
        self.next_word()?;
        let text = std::str::from_utf8(&self.word).unwrap_or("?");
        let bad = || fault(format!("{text:?} is not a number of its type ({scalar:?})"));
        parse(text, scalar).ok_or_else(bad)
    }

    /// Reads the next word between white space.
    fn next_word(&mut self) -> io::Result<()> {
        self.word.clear();
        for byte in self.reader.by_ref().bytes() {
            let byte = byte?;
            self.at += 1;
            if !byte.is_ascii_whitespace() {
                if self.word.len() == 64 {
                    return Err(fault("a number of more than 64 characters"));
                }
                self.word.push(byte);
            } else if !self.word.is_empty() {
                return Ok(());
            }
        }
        if self.word.is_empty() { Err(ErrorKind::UnexpectedEof.into()) } else { Ok(()) }
    }
}

/// The number as its type stores it, little-endian; whole numbers may be written with a point.
fn parse(text: &str, scalar: Scalar) -> Option<[u8; 8]> {
    fn widen<const N: usize>(bytes: [u8; N]) -> [u8; 8] {
        let mut out = [0; 8];
        out[..N].copy_from_slice(&bytes);
        out
    }
    let whole = |low: i64, high: i64| {
        let float = || text.parse::<f64>().ok().filter(|x| x.fract() == 0.0).map(|x| x as i64);
        let number = text.parse::<i64>().ok().or_else(float)?;
        (low..=high).contains(&number).then_some(number.to_le_bytes())
    };
    match scalar {
        Scalar::I8 => whole(i8::MIN.into(), i8::MAX.into()),
        Scalar::U8 => whole(0, u8::MAX.into()),
        Scalar::I16 => whole(i16::MIN.into(), i16::MAX.into()),
        Scalar::U16 => whole(0, u16::MAX.into()),
        Scalar::I32 => whole(i32::MIN.into(), i32::MAX.into()),
        Scalar::U32 => whole(0, u32::MAX.into()),
        Scalar::F32 => Some(widen(number::<f32>(text).ok()?.to_le_bytes())),
        Scalar::F64 => Some(widen(number::<f64>(text).ok()?.to_le_bytes())),
    }
}

/// A list's count or item, from its little-endian bytes.
fn integer(number: [u8; 8], scalar: Scalar) -> i64 {
    Column { offset: 0, scalar }.int(&number)
}
