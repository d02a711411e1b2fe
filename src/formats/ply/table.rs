//! The rows of one element at a fixed stride, little-endian: what every body is brought to.
//!
//! A binary little-endian element whose only list is the corner list of its faces *is* such a table:
//! it stays in the file and is read block by block, from any thread. Everything else (ascii,
//! big-endian, other lists) is rewritten into one in memory first, see [`super::transcode`].

use super::header::{Element, Encoding, Header, Kind, Scalar};
use super::{transcode, views};
use crate::error::{Error, Result};
use crate::formats::{MAX_TRIANGLES, Source, not_a_triangle};
use std::fs::File;
use std::path::Path;

/// Bytes read at once: fits the second-level cache, large against the cost of a system call.
const BLOCK: usize = 1 << 19;

/// Where a number stands in a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Column {
    pub(super) offset: usize,
    pub(super) scalar: Scalar,
}

impl Column {
    /// The number, as f32; f64 and large integers are rounded.
    #[inline]
    pub(super) fn f32(self, row: &[u8]) -> f32 {
        match self.scalar {
            Scalar::F32 => f32::from_le_bytes(bytes(row, self.offset)),
            Scalar::F64 => f64::from_le_bytes(bytes(row, self.offset)) as f32,
            _ => self.int(row) as f32,
        }
    }

    /// The number, truncated if it is a float.
    #[inline]
    pub(super) fn int(self, row: &[u8]) -> i64 {
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

/// `N` bytes of a row; a row is always as long as the layout its columns come from.
#[inline]
fn bytes<const N: usize>(row: &[u8], offset: usize) -> [u8; N] {
    let mut out = [0; N];
    out.copy_from_slice(&row[offset..offset + N]);
    out
}

/// Where everything stands in a row of an element.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    pub(super) stride: usize,
    columns: Vec<(String, Column)>,
    /// The count and the first number of the corner list, which always holds three.
    pub(super) corners: Option<(Column, Column)>,
}

impl Layout {
    /// All single numbers and the corner list, in file order; other lists take no room.
    fn of(element: &Element) -> Self {
        let mut layout = Layout::default();
        for property in &element.properties {
            match property.kind {
                Kind::Scalar(scalar) => {
                    let column = layout.push(scalar, 1);
                    layout.columns.push((property.name.clone(), column));
                }
                Kind::List { count, item } if is_corner_list(&property.name) => {
                    layout.corners = Some((layout.push(count, 1), layout.push(item, 3)));
                }
                Kind::List { .. } => {}
            }
        }
        layout
    }

    fn push(&mut self, scalar: Scalar, count: usize) -> Column {
        let column = Column { offset: self.stride, scalar };
        self.stride += scalar.size() * count;
        column
    }
}

/// The two names in use for the corners of a face.
pub(super) fn is_corner_list(name: &str) -> bool {
    name == "vertex_indices" || name == "vertex_index"
}

/// The rows of one element.
#[derive(Debug)]
pub(super) struct Table<'a> {
    path: &'a Path,
    element: &'a Element,
    layout: Layout,
    rows: usize,
    bytes: Bytes<'a>,
}

#[derive(Debug)]
enum Bytes<'a> {
    File(&'a File, u64),
    Memory(Vec<u8>),
}

impl Table<'_> {
    /// True when every row is known to take `stride` bytes that can be used, or skipped, as they are.
    fn is_in_place(&self, encoding: Encoding, keep: bool) -> bool {
        let lists = self.element.properties.iter().filter(|p| matches!(p.kind, Kind::List { .. })).count();
        match encoding {
            Encoding::Ascii => false,
            Encoding::Big => lists == 0 && !keep,
            // Corner lists are taken to be three long here and checked when they are read.
            Encoding::Little => {
                lists == 0 || (lists == 1 && self.layout.corners.is_some() && self.element.name == "face")
            }
        }
    }

    /// Takes the promised number of rows, once `left` bytes have been seen to be enough for them.
    fn count_rows(&mut self, left: u64) -> Result<()> {
        let (rows, stride) = (self.element.rows, self.layout.stride as u64);
        if rows.checked_mul(stride).is_some_and(|bytes| bytes <= left) {
            // Only rows without any property can be too many here, and those are looked at no further.
            self.rows = usize::try_from(rows).unwrap_or(usize::MAX);
            return Ok(());
        }
        // A face with fewer than three corners makes the file shorter as well: name it if there is one.
        self.rows = usize::try_from(left / stride).unwrap_or(usize::MAX);
        self.check_counts()?;
        let reason =
            format!("promises {rows} rows of {stride} bytes, but only {left} bytes follow: cut short");
        Err(Error::malformed(self.path, format!("element {}", self.element.name), reason))
    }

    /// Proves that every corner list holds three numbers.
    fn check_counts(&self) -> Result<()> {
        let Some((count, _)) = self.layout.corners else { return Ok(()) };
        let (step, mut buffer) = (self.rows_per_block(), Vec::new());
        for first in (0..self.rows).step_by(step) {
            let rows = self.block(first, step.min(self.rows - first), &mut buffer)?;
            for (i, row) in rows.chunks_exact(self.layout.stride).enumerate() {
                if count.int(row) != 3 {
                    return Err(self.error(first + i, not_a_triangle(count.int(row))));
                }
            }
        }
        Ok(())
    }

    pub(super) fn rows(&self) -> usize {
        self.rows
    }

    pub(super) fn stride(&self) -> usize {
        self.layout.stride
    }

    /// Rows that make one block.
    pub(super) fn rows_per_block(&self) -> usize {
        (BLOCK / self.layout.stride.max(1)).max(1)
    }

    pub(super) fn find(&self, name: &str) -> Option<Column> {
        self.layout.columns.iter().find(|(n, _)| n == name).map(|(_, column)| *column)
    }

    pub(super) fn column(&self, name: &str) -> Result<Column> {
        self.find(name).ok_or_else(|| {
            let reason = format!("has no property {name}");
            Error::malformed(self.path, format!("element {}", self.element.name), reason)
        })
    }

    /// Count and first corner of the face list.
    pub(super) fn corners(&self) -> Result<(Column, Column)> {
        let error = |reason| Error::malformed(self.path, format!("element {}", self.element.name), reason);
        let corners =
            self.layout.corners.ok_or_else(|| error("has no list vertex_indices or vertex_index"))?;
        if !corners.1.scalar.is_integer() {
            return Err(error("has float corner numbers; wants an integer type"));
        }
        Ok(corners)
    }

    /// A broken row.
    pub(super) fn error(&self, row: usize, reason: impl Into<String>) -> Error {
        Error::malformed(self.path, format!("{} {row}", self.element.name), reason)
    }

    /// `rows` rows from `first` on, read into `buffer` where they are not in memory already.
    pub(super) fn block<'b>(
        &'b self,
        first: usize,
        rows: usize,
        buffer: &'b mut Vec<u8>,
    ) -> Result<&'b [u8]> {
        let (from, len) = (first * self.layout.stride, rows * self.layout.stride);
        match &self.bytes {
            Bytes::Memory(bytes) => Ok(&bytes[from..from + len]),
            Bytes::File(..) => {
                buffer.resize(len, 0);
                self.fill(first, buffer)?;
                Ok(buffer)
            }
        }
    }

    /// Copies whole rows from `first` on into `out`.
    pub(super) fn fill(&self, first: usize, out: &mut [u8]) -> Result<()> {
        let from = first * self.layout.stride;
        match &self.bytes {
            Bytes::Memory(bytes) => out.copy_from_slice(&bytes[from..from + out.len()]),
            Bytes::File(file, offset) => {
                read_at(file, out, offset + from as u64).map_err(|e| Error::io(self.path, e))?;
            }
        }
        Ok(())
    }
}

#[cfg(unix)]
fn read_at(file: &File, out: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, out, offset)
}

#[cfg(windows)]
fn read_at(file: &File, mut out: &mut [u8], mut offset: u64) -> std::io::Result<()> {
    while !out.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, out, offset)?;
        if read == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        out = &mut out[read..];
        offset += read as u64;
    }
    Ok(())
}

/// The two elements every kind of triangle PLY has, and the cameras that a soup may come with.
pub(super) struct Tables<'a> {
    pub(super) vertices: Table<'a>,
    pub(super) faces: Table<'a>,
    pub(super) views: Option<Table<'a>>,
}

/// Finds the rows of `vertex`, `face` and `view`, checking that the file is as long as they need.
pub(super) fn locate<'a>(source: &'a Source, header: &'a Header) -> Result<Tables<'a>> {
    let (mut vertices, mut faces, mut cameras) = (None, None, None);
    let with_cameras = views::element(header);
    let mut at = header.body;
    for element in &header.elements {
        let slot = match element.name.as_str() {
            "vertex" => Some(&mut vertices),
            "face" => Some(&mut faces),
            _ if with_cameras == Some(element) => Some(&mut cameras),
            _ => None,
        };
        let keep = slot.is_some();
        if element.name == "face" && element.rows > MAX_TRIANGLES {
            let reason =
                format!("promises {} triangles; the most we take is {MAX_TRIANGLES}: split it", element.rows);
            return Err(Error::unsupported(&source.path, reason));
        }
        let (layout, bytes) = (Layout::of(element), Bytes::File(&source.file, at));
        let mut table = Table { path: &source.path, element, layout, rows: 0, bytes };
        if table.is_in_place(header.encoding, keep) {
            table.count_rows(source.len.saturating_sub(at))?;
            at += element.rows * table.layout.stride as u64;
        } else {
            let out = transcode::rows(source, header.encoding, element, at, keep)?;
            // The rows were really read, so their number fits a usize.
            (table.rows, table.bytes, at) = (element.rows as usize, Bytes::Memory(out.bytes), out.end);
        }
        if let Some(slot) = slot {
            *slot = Some(table);
        }
        if vertices.is_some() && faces.is_some() && with_cameras.is_some() == cameras.is_some() {
            break;
        }
    }
    match (vertices, faces) {
        (Some(vertices), Some(faces)) => Ok(Tables { vertices, faces, views: cameras }),
        (None, _) => Err(Error::malformed(&source.path, "header", "has no element vertex")),
        (_, None) => Err(Error::malformed(&source.path, "header", "has no element face")),
    }
}
