//! Rows in ascii, big-endian or of varying length, rewritten as little-endian rows of a fixed stride.
//!
//! Memory grows with the rows read, not with the numbers in the header.

use super::header::Column;
use super::header::{Element, Encoding, PropertyType, Scalar};
use crate::faces::{check_corners, not_a_triangle};
use crate::source::Source;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use trisplat_scene::{Error, Result};

/// What is wanted of an element's rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Wanted {
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
    pub(super) polygons: Polygons,
    /// The byte after the last row.
    pub(super) end: u64,
}

/// All corners of polygons.
#[derive(Debug, Default)]
pub(super) struct Polygons {
    /// Faces and the ends of their corners in `corners`, in order.
    faces: Vec<(usize, usize)>,
    corners: Vec<i64>,
}

impl Polygons {
    /// Faces and their corners, in order of the faces.
    pub(super) fn iter(&self) -> impl Iterator<Item = (usize, &[i64])> {
        let starts = std::iter::once(0).chain(self.faces.iter().map(|(_, end)| *end));
        self.faces.iter().zip(starts).map(|(&(face, end), start)| (face, &self.corners[start..end]))
    }
}

/// Reads the rows of `element`, which start at byte `at`.
pub(super) fn rows(
    source: &Source,
    encoding: Encoding,
    element: &Element,
    at: u64,
    wanted: Wanted,
) -> Result<Transcoded> {
    let mut out = Transcoded { end: at, ..Transcoded::default() };
    // Rows without properties take no bytes, so a header may contain any number of them.
    if element.properties.is_empty() {
        return Ok(out);
    }
    let mut file = &*source.file;
    file.seek(SeekFrom::Start(at)).map_err(|e| Error::io(&source.path, e))?;
    let mut input = Input { reader: BufReader::with_capacity(1 << 16, file), encoding, at, len: source.len };
    for row in 0..element.rows {
        input.row(element, row as usize, wanted, &mut out).map_err(|fault| match fault {
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

type ReadResult<T> = std::result::Result<T, Fault>;

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
    /// Next byte of the file.
    at: u64,
    len: u64,
}

impl Input<'_> {
    fn row(&mut self, element: &Element, row: usize, wanted: Wanted, out: &mut Transcoded) -> ReadResult<()> {
        for property in &element.properties {
            match property.kind {
                PropertyType::Scalar(scalar) => {
                    let number = self.number(scalar)?;
                    if wanted != Wanted::Nothing {
                        out.bytes.extend_from_slice(&number[..scalar.size()]);
                    }
                }
                PropertyType::List { count, item }
                    if wanted != Wanted::Nothing && property.is_corner_list() =>
                {
                    self.corners(count, item, row, wanted, out)?;
                }
                PropertyType::List { count, item } => {
                    let length = self.number(count)?;
                    self.skip_list(integer(length, count), item)?;
                }
            }
        }
        Ok(())
    }

    /// A face's corners: three go into its row, and those of a polygon into `polygons` too.
    fn corners(
        &mut self,
        count: Scalar,
        item: Scalar,
        row: usize,
        wanted: Wanted,
        out: &mut Transcoded,
    ) -> ReadResult<()> {
        let length = integer(self.number(count)?, count);
        if wanted == Wanted::Triangles && length != 3 {
            return Err(Fault::Text(not_a_triangle(length)));
        }
        let length = check_corners(length).map_err(Fault::Text)?;
        // Three, in any integer type.
        out.bytes.extend_from_slice(&3u64.to_le_bytes()[..count.size()]);
        for corner in 0..length {
            let number = self.number(item)?;
            if corner < 3 {
                out.bytes.extend_from_slice(&number[..item.size()]);
            }
            if length > 3 {
                out.polygons.corners.push(integer(number, item));
            }
        }
        if length > 3 {
            out.polygons.faces.push((row, out.polygons.corners.len()));
        }
        Ok(())
    }

    fn skip_list(&mut self, length: i64, item: Scalar) -> ReadResult<()> {
        let length = u64::try_from(length).map_err(|_| Fault::Text(format!("a list of {length} numbers")))?;
        if self.encoding != Encoding::Ascii {
            return self.skip(length * item.size() as u64);
        }
        (0..length).try_for_each(|_| self.number(item).map(drop))
    }

    /// The next number as little-endian bytes.
    fn number(&mut self, scalar: Scalar) -> ReadResult<[u8; 8]> {
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

    fn skip(&mut self, bytes: u64) -> ReadResult<()> {
        if bytes > self.len.saturating_sub(self.at) {
            return Err(Fault::End);
        }
        self.at += bytes;
        // The rest of a file is below i64::MAX.
        Ok(self.reader.seek_relative(bytes as i64)?)
    }

    fn ascii(&mut self, scalar: Scalar) -> ReadResult<[u8; 8]> {
        let mut buffer = [0; 64];
        let word = self.word(&mut buffer)?;
        let text = std::str::from_utf8(word).unwrap_or("?");
        let bad = || Fault::Text(format!("{text:?} is not a number of its type ({scalar:?})"));
        parse(text, scalar).ok_or_else(bad)
    }

    /// The next word between white space.
    fn word<'b>(&mut self, buffer: &'b mut [u8; 64]) -> ReadResult<&'b [u8]> {
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
        Scalar::F32 => Some(widen(text.parse::<f32>().ok()?.to_le_bytes())),
        Scalar::F64 => Some(widen(text.parse::<f64>().ok()?.to_le_bytes())),
    }
}

/// A list's count or item, from its little-endian bytes.
fn integer(number: [u8; 8], scalar: Scalar) -> i64 {
    Column { offset: 0, scalar }.int(&number)
}
