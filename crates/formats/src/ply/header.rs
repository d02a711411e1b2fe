//! The header of a PLY file: elements, their properties, and comments.

use crate::Source;
use std::io::{BufRead, BufReader, Read};
use trisplat_scene::input::BYTE_ORDER_MARK;
use trisplat_scene::{Error, Result, excerpt};

/// Maximum size of a header, bytes: far above any real one.
const MAX_HEADER_BYTES: u64 = 1 << 20;

/// Maximum number of elements in a file, or of properties in an element.
const MAX_ELEMENTS: usize = 1024;

/// Encoding of the body.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    Little,
    Big,
}

/// The eight number types of PLY.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Scalar::I8,
            "uchar" | "uint8" => Scalar::U8,
            "short" | "int16" => Scalar::I16,
            "ushort" | "uint16" => Scalar::U16,
            "int" | "int32" => Scalar::I32,
            "uint" | "uint32" => Scalar::U32,
            "float" | "float32" => Scalar::F32,
            "double" | "float64" => Scalar::F64,
            _ => return None,
        })
    }

    /// Bytes in a binary file.
    pub(super) fn size(self) -> usize {
        match self {
            Scalar::I8 | Scalar::U8 => 1,
            Scalar::I16 | Scalar::U16 => 2,
            Scalar::I32 | Scalar::U32 | Scalar::F32 => 4,
            Scalar::F64 => 8,
        }
    }

    pub(super) fn is_integer(self) -> bool {
        !matches!(self, Scalar::F32 | Scalar::F64)
    }
}

/// One number, or a count followed by that many numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PropertyType {
    Scalar(Scalar),
    List { count: Scalar, item: Scalar },
}

/// A property of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) kind: PropertyType,
}

impl Property {
    /// True for the list of a face's corners, under either of its two usual names.
    pub(super) fn is_corner_list(&self) -> bool {
        self.name == "vertex_indices" || self.name == "vertex_index"
    }
}

/// An element: its name and the form of its rows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    /// Rows according to the header; not trusted before the file's length is checked.
    pub(super) rows: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    pub(super) fn has(&self, property: &str) -> bool {
        self.properties.iter().any(|p| p.name == property)
    }

    /// Names of its single numbers, and whether they are whole.
    pub(super) fn columns(&self) -> Vec<(&str, bool)> {
        let column = |property: &'_ Property| match property.kind {
            PropertyType::Scalar(scalar) => Some(scalar.is_integer()),
            PropertyType::List { .. } => None,
        };
        self.properties.iter().filter_map(|p| Some((p.name.as_str(), column(p)?))).collect()
    }
}

/// The header of a PLY file: its encoding, elements and comments.
#[derive(Debug)]
pub struct PlyHeader {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    pub(super) comments: Vec<String>,
    /// Byte at which the body starts.
    pub(super) body: u64,
}

impl PlyHeader {
    pub(super) fn element(&self, name: &str) -> Option<&Element> {
        self.elements.iter().find(|e| e.name == name)
    }
}

/// Reads up to and including `end_header`.
pub fn read(source: &mut Source) -> Result<PlyHeader> {
    let path = source.path.clone();
    let io = |e| Error::io(&path, e);
    // Old programs end lines with `\r` alone.
    let head = source.head()?;
    let head = head.strip_prefix(BYTE_ORDER_MARK).unwrap_or(&head);
    let is_old = head.starts_with(b"ply\r") && head.get(4) != Some(&b'\n');
    let end = if is_old { b'\r' } else { b'\n' };
    let mut reader = BufReader::with_capacity(1 << 14, &*source.file).take(MAX_HEADER_BYTES);
    let mut draft = HeaderDraft::default();
    let mut line = Vec::new();
    let mut number = 0;
    loop {
        line.clear();
        reader.read_until(end, &mut line).map_err(io)?;
        number += 1;
        let at = format!("header line {number}");
        if line.last() != Some(&end) {
            return Err(Error::malformed(
                &path,
                at,
                draft.why_cut_short(reader.limit() == 0, &line),
            ));
        }
        let mark = if number == 1 { BYTE_ORDER_MARK } else { &[] };
        let text = String::from_utf8_lossy(line.strip_prefix(mark).unwrap_or(&line));
        if draft.take_line(text.trim()).map_err(|reason| Error::malformed(&path, at, reason))? {
            break;
        }
    }
    let body = MAX_HEADER_BYTES - reader.limit();
    let encoding = draft.encoding.ok_or_else(|| {
        Error::malformed(
            &path,
            "header",
            "has no format line; expected `format binary_little_endian 1.0`",
        )
    })?;
    Ok(PlyHeader { encoding, elements: draft.elements, comments: draft.comments, body })
}

/// A header during reading.
#[derive(Default)]
struct HeaderDraft {
    magic: bool,
    encoding: Option<Encoding>,
    elements: Vec<Element>,
    comments: Vec<String>,
}

impl HeaderDraft {
    fn why_cut_short(&self, too_long: bool, line: &[u8]) -> String {
        if !self.magic && line.is_empty() {
            "the file is empty".into()
        } else if !self.magic && !line.starts_with(b"ply") {
            "is not a PLY file: it must start with the line `ply`".into()
        } else if too_long {
            "no end_header within the first 1 MiB; not a PLY file, or a broken one".into()
        } else {
            "the file ends before end_header; it was cut short".into()
        }
    }

    /// Parses one line; true when it was `end_header`.
    fn take_line(&mut self, line: &str) -> Result<bool, String> {
        if !self.magic {
            self.magic = line == "ply";
            return if self.magic {
                Ok(false)
            } else {
                Err("is not a PLY file: it must start with the line `ply`".into())
            };
        }
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match word {
            "end_header" => return Ok(true),
            "comment" => self.comments.push(rest.trim().to_owned()),
            "obj_info" | "" => {}
            "format" => self.encoding = Some(parse_format(rest)?),
            "element" => {
                let element = parse_element(rest)?;
                if self.elements.iter().any(|e| e.name == element.name) {
                    return Err(format!("element {} is declared twice", excerpt(&element.name)));
                }
                if self.elements.len() == MAX_ELEMENTS {
                    return Err(format!("more than {MAX_ELEMENTS} elements"));
                }
                self.elements.push(element);
            }
            "property" => {
                let property = parse_property(rest)?;
                let element =
                    self.elements.last_mut().ok_or("a property before the first element")?;
                if element.has(&property.name) {
                    return Err(format!("property {} is declared twice", excerpt(&property.name)));
                }
                if element.properties.len() == MAX_ELEMENTS {
                    return Err(format!("more than {MAX_ELEMENTS} properties in one element"));
                }
                element.properties.push(property);
            }
            _ => {
                return Err(format!(
                    "cannot make sense of {:?}; is end_header missing?",
                    excerpt(line)
                ));
            }
        }
        Ok(false)
    }
}

fn parse_format(rest: &str) -> Result<Encoding, String> {
    match rest.split_whitespace().collect::<Vec<_>>()[..] {
        ["ascii", "1.0"] => Ok(Encoding::Ascii),
        ["binary_little_endian", "1.0"] => Ok(Encoding::Little),
        ["binary_big_endian", "1.0"] => Ok(Encoding::Big),
        _ => Err(format!(
            "unknown format {:?}; expected ascii, binary_little_endian or binary_big_endian, version 1.0",
            excerpt(rest)
        )),
    }
}

fn parse_element(rest: &str) -> Result<Element, String> {
    let [name, rows] = rest.split_whitespace().collect::<Vec<_>>()[..] else {
        return Err(format!("expected `element NAME COUNT`, not {:?}", excerpt(rest)));
    };
    let rows = rows.parse::<u64>().map_err(|_| {
        format!("element {} counts {:?}; expected a whole number", excerpt(name), excerpt(rows))
    })?;
    Ok(Element { name: name.to_owned(), rows, properties: Vec::new() })
}

fn parse_property(rest: &str) -> Result<Property, String> {
    let scalar = |name: &str| {
        Scalar::parse(name).ok_or_else(|| {
            format!(
                "unknown type {:?}; expected char, uchar, short, ushort, int, uint, float or double",
                excerpt(name)
            )
        })
    };
    match rest.split_whitespace().collect::<Vec<_>>()[..] {
        ["list", count, item, name] => {
            let count = scalar(count)?;
            let item = scalar(item)?;
            if !count.is_integer() {
                return Err(format!(
                    "the list {} counts in floats; expected an integer type",
                    excerpt(name)
                ));
            }
            Ok(Property { name: name.to_owned(), kind: PropertyType::List { count, item } })
        }
        [kind, name] => {
            Ok(Property { name: name.to_owned(), kind: PropertyType::Scalar(scalar(kind)?) })
        }
        _ => Err(format!(
            "expected `property TYPE NAME` or `property list TYPE TYPE NAME`, not {:?}",
            excerpt(rest)
        )),
    }
}

// ---- One number in the rows of an element -------------------------------------------------------

/// The place of a number in a row.
#[derive(Debug, Clone, Copy)]
pub struct Column {
    pub(super) offset: usize,
    pub(super) scalar: Scalar,
}

impl Column {
    /// True for an unsigned byte.
    pub fn is_byte(self) -> bool {
        self.scalar == Scalar::U8
    }

    /// The number, as f32; f64 and large integers are rounded.
    #[inline]
    pub(super) fn f32(self, row: &[u8]) -> f32 {
        match self.scalar {
            Scalar::F32 => f32::from_le_bytes(bytes(row, self.offset)),
            _ => self.f64(row) as f32,
        }
    }

    /// The number, exact for every type.
    #[inline]
    pub fn f64(self, row: &[u8]) -> f64 {
        match self.scalar {
            Scalar::F32 => f32::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::F64 => f64::from_le_bytes(bytes(row, self.offset)),
            _ => self.int(row) as f64,
        }
    }

    /// The number, truncated if it is a float.
    #[inline]
    pub fn int(self, row: &[u8]) -> i64 {
        match self.scalar {
            Scalar::U8 => row[self.offset].into(),
            Scalar::I8 => (row[self.offset] as i8).into(),
            Scalar::U16 => u16::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::I16 => i16::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::U32 => u32::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::I32 => i32::from_le_bytes(bytes(row, self.offset)).into(),
            Scalar::F32 | Scalar::F64 => self.f32(row) as i64,
        }
    }
}

/// The bytes of one number in a row; a row is always as long as the layout its columns come from.
#[inline]
fn bytes<const N: usize>(row: &[u8], offset: usize) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&row[offset..offset + N]);
    out
}
