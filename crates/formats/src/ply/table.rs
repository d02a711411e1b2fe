//! The rows of one element at a fixed stride, little-endian: the common form of every body.
//!
//! A binary little-endian element without lists, or with only lists of triangles, has this form already: it
//! stays in the file and is read block by block, from any thread. Everything else (ascii, big-endian,
//! polygons, other lists) is rewritten into one in memory first, see [`super::transcode`].

use super::header::Column;
use super::header::{Element, Encoding, PropertyType, Scalar};
use super::transcode;
use super::transcode::{Polygons, Wanted};
use crate::faces::{check_corners, not_a_triangle};
use crate::lines::write_blocks;
use crate::source::Source;
use std::fs::File;
use std::io;
use std::io::Write;
use std::path::Path;
use trisplat_scene::{Error, Result, parallel};

/// Bytes read at once: fits the second-level cache, large against the cost of a system call.
const BLOCK: usize = 1 << 19;

/// The layout of an element's row.
#[derive(Debug, Clone, Default)]
pub(super) struct Layout {
    pub(super) stride: usize,
    columns: Vec<(String, Column)>,
    /// The count and the first number of the corner list, which always holds three here.
    pub(super) corners: Option<(Column, Column)>,
}

impl Layout {
    /// All single numbers and the corner list, in file order; other lists take no room.
    fn of(element: &Element) -> Self {
        let mut layout = Layout::default();
        for property in &element.properties {
            match property.kind {
                PropertyType::Scalar(scalar) => {
                    let column = layout.push(scalar, 1);
                    layout.columns.push((property.name.clone(), column));
                }
                PropertyType::List { count, item } if property.is_corner_list() => {
                    layout.corners = Some((layout.push(count, 1), layout.push(item, 3)));
                }
                PropertyType::List { .. } => {}
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

/// The rows of one element.
#[derive(Debug)]
pub struct Table<'a> {
    path: &'a Path,
    element: &'a Element,
    layout: Layout,
    rows: usize,
    bytes: Body<'a>,
    polygons: Polygons,
}

/// Where the rows are.
#[derive(Debug)]
enum Body<'a> {
    File(&'a File, u64),
    Memory(Vec<u8>),
}

impl<'a> Table<'a> {
    /// The rows of `element`, which start at byte `at`, and the byte after the last one. The file is checked
    /// to be long enough for them.
    pub(super) fn open(
        source: &'a Source,
        encoding: Encoding,
        element: &'a Element,
        at: u64,
        wanted: Wanted,
    ) -> Result<(Self, u64)> {
        let (layout, bytes) = (Layout::of(element), Body::File(&source.file, at));
        let polygons = Polygons::default();
        let mut table = Self { path: &source.path, element, layout, rows: 0, bytes, polygons };
        if table.is_in_place(encoding, wanted) && table.count_rows(source.len.saturating_sub(at), wanted)? {
            let end = at + element.rows * table.layout.stride as u64;
            return Ok((table, end));
        }
        let out = transcode::rows(source, encoding, element, at, wanted)?;
        // The rows were read, so their number fits a usize.
        (table.rows, table.bytes, table.polygons) =
            (element.rows as usize, Body::Memory(out.bytes), out.polygons);
        Ok((table, out.end))
    }

    /// True when every row takes `stride` bytes in the final form, as long as all faces are triangles.
    fn is_in_place(&self, encoding: Encoding, wanted: Wanted) -> bool {
        let is_list = |kind| matches!(kind, PropertyType::List { .. });
        let lists = self.element.properties.iter().filter(|p| is_list(p.kind)).count();
        match encoding {
            Encoding::Ascii => false,
            Encoding::Big => lists == 0 && wanted == Wanted::Nothing,
            Encoding::Little if lists == 0 => true,
            Encoding::Little => {
                lists == 1
                    && self.layout.corners.is_some()
                    && self.element.name == "face"
                    && wanted != Wanted::Nothing
            }
        }
    }

    /// Takes the number of rows from the header if `left` bytes suffice for them; false when polygons, which
    /// make rows longer, are among them. If polygons are not permitted, faces are checked during reading.
    fn count_rows(&mut self, left: u64, wanted: Wanted) -> Result<bool> {
        let (rows, stride) = (self.element.rows, self.layout.stride as u64);
        let enough = rows.checked_mul(stride).is_some_and(|bytes| bytes <= left);
        // Only rows without properties can be too many here, and these are not read.
        let there = if enough { rows } else { left / stride };
        self.rows = usize::try_from(there).unwrap_or(usize::MAX);
        if enough && wanted != Wanted::Polygons {
            return Ok(true);
        }
        match self.first_polygon()? {
            // A face with fewer than three corners also makes the file shorter: name it if there is one.
            Some((row, corners)) if wanted == Wanted::Polygons => {
                check_corners(corners).map_err(|reason| self.error(row, reason))?;
                Ok(false)
            }
            Some((row, corners)) => Err(self.error(row, not_a_triangle(corners))),
            None if enough => Ok(true),
            None => {
                let reason = format!(
                    "promises {rows} rows of {stride} bytes, but only {left} bytes follow: cut short"
                );
                Err(Error::malformed(self.path, format!("element {}", self.element.name), reason))
            }
        }
    }

    /// The first face that is not a triangle, and its number of corners.
    fn first_polygon(&self) -> Result<Option<(usize, i64)>> {
        let Some((count, _)) = self.layout.corners else { return Ok(None) };
        let step = self.rows_per_block();
        let found = parallel::find_first(self.rows.div_ceil(step), 1, |block| {
            let (first, mut buffer) = (block * step, Vec::new());
            let rows = match self.block(first, step.min(self.rows - first), &mut buffer) {
                Ok(rows) => rows,
                Err(error) => return Some(Err(error)),
            };
            let mut counts = rows.chunks_exact(self.layout.stride).map(|row| count.int(row)).enumerate();
            counts.find(|(_, count)| *count != 3).map(|(i, count)| Ok((first + i, count)))
        });
        found.transpose()
    }

    /// The faces with more than three corners; their rows hold the first three.
    pub(super) fn polygons(&self) -> &Polygons {
        &self.polygons
    }

    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Bytes of a row.
    pub fn stride(&self) -> usize {
        self.layout.stride
    }

    /// Rows that are read at once.
    pub fn rows_per_block(&self) -> usize {
        (BLOCK / self.layout.stride.max(1)).max(1)
    }

    /// The single number of that name, if the rows have one.
    pub fn find(&self, name: &str) -> Option<Column> {
        self.layout.columns.iter().find(|(n, _)| n == name).map(|(_, column)| *column)
    }

    /// The single number of that name, which the rows must have.
    pub fn column(&self, name: &str) -> Result<Column> {
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
            return Err(error("has float corner numbers; expected an integer type"));
        }
        Ok(corners)
    }

    /// The file and one of its rows, for messages.
    pub(super) fn place(&self, row: usize) -> String {
        format!("{}: {} {row}", self.path.display(), self.element.name)
    }

    /// A broken row.
    pub(super) fn error(&self, row: usize, reason: impl Into<String>) -> Error {
        Error::malformed(self.path, format!("{} {row}", self.element.name), reason)
    }

    /// `rows` rows from `first` on, read into `buffer` if they are not in memory.
    pub fn block<'b>(&'b self, first: usize, rows: usize, buffer: &'b mut Vec<u8>) -> Result<&'b [u8]> {
        let (from, len) = (first * self.layout.stride, rows * self.layout.stride);
        match &self.bytes {
            Body::Memory(bytes) => Ok(&bytes[from..from + len]),
            Body::File(..) => {
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
            Body::Memory(bytes) => out.copy_from_slice(&bytes[from..from + out.len()]),
            Body::File(file, offset) => {
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

/// Without a system call for reading at an offset, one thread at a time seeks and reads.
#[cfg(not(any(unix, windows)))]
fn read_at(mut file: &File, out: &mut [u8], offset: u64) -> std::io::Result<()> {
    use std::io::{Read, Seek, SeekFrom};
    static TURN: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(out)
}

// ---- What both PLY writers share ---------------------------------------------------------------------

/// Floats as they are in a binary little-endian file.
pub(super) fn write_floats(out: &mut dyn Write, floats: &[f32]) -> io::Result<()> {
    if cfg!(target_endian = "little") {
        return out.write_all(bytemuck::cast_slice(floats));
    }
    write_blocks(out, floats.len(), |i, block| block.extend_from_slice(&floats[i].to_le_bytes()))
}

/// A triangle's `list uchar int vertex_indices`.
pub(super) fn push_corners(block: &mut Vec<u8>, corners: [u32; 3]) {
    block.push(3);
    for corner in corners {
        block.extend_from_slice(&corner.to_le_bytes());
    }
}

/// A comment line, unless it is empty.
pub(super) fn push_comment(header: &mut String, comment: &str) {
    if !comment.is_empty() {
        *header += &format!("comment {comment}\n");
    }
}
