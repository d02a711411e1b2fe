//! The rows of one element at a fixed stride, little-endian: the common form of every body.
//!
//! A binary little-endian element without lists, or with only lists of triangles, has this form
//! already: it stays in the file and is read block by block, from any thread. Everything else
//! (ascii, big-endian, polygons, other lists) is rewritten into one in memory first, see
//! [`super::transcode`].

use super::header::{Column, Element, Encoding, PlyHeader, PropertyType, Scalar};
use super::transcode::{self, RowSelection};
use crate::Source;
use crate::faces::{CornerUvs, FaceList, not_a_triangle};
use crate::finish::{origin_of, sampled};
use crate::lines::write_blocks;
use glam::{DVec3, Vec2, Vec3};
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::slice::ChunksExact;
use trisplat_scene::{Error, Limits, Result, parallel, sh_count};

/// Bytes read at once: fits the second-level cache, large against the cost of a system call.
const BLOCK: usize = 1 << 19;

/// The rows of one element.
#[derive(Debug)]
pub struct PlyTable<'a> {
    pub(super) path: &'a Path,
    pub(super) element: &'a Element,
    pub(super) rows: usize,
    /// Bytes of a row.
    stride: usize,
    /// All single numbers, in file order.
    columns: Vec<(&'a str, Column)>,
    /// The count and the first number of the corner list, which always holds three here.
    corners: Option<(Column, Column)>,
    body: RowStorage<'a>,
    /// The faces with more than three corners, in order; their rows hold the first three.
    polygons: Vec<(usize, Vec<i64>)>,
    /// The numbers of all lists of texture coordinates.
    uv_numbers: Vec<f32>,
    /// End of each row's numbers in `uv_numbers`; empty without such lists.
    uv_ends: Vec<usize>,
}

/// Storage of the rows.
#[derive(Debug)]
enum RowStorage<'a> {
    /// The file, and the byte at which the rows begin.
    File(&'a File, u64),
    Memory(Vec<u8>),
}

/// The rows of the elements called `names`, `None` for one that the file lacks. Faces may be
/// `polygons`.
///
/// # Errors
///
/// More rows than a scene may have, before any is read; a file that is too short for them.
pub(super) fn open<'a, const N: usize>(
    source: &'a Source,
    header: &'a PlyHeader,
    names: [&str; N],
    polygons: bool,
    limits: &Limits,
) -> Result<[Option<PlyTable<'a>>; N]> {
    let place = |element: &Element| format!("{}: element {}", source.path.display(), element.name);
    header.element("face").map_or(Ok(()), |face| limits.triangles(place(face), face.rows))?;
    header
        .element("vertex")
        .map_or(Ok(()), |vertex| limits.vertices(place(vertex), vertex.rows))?;
    let slot = |element: &Element| names.iter().position(|name| *name == element.name);
    let last = header.elements.iter().rposition(|e| slot(e).is_some()).map_or(0, |last| last + 1);
    let mut tables = [const { None }; N];
    let mut at = header.body;
    for element in &header.elements[..last] {
        let selection = match slot(element) {
            None => RowSelection::Nothing,
            Some(_) if polygons && element.name == "face" => RowSelection::Polygons,
            Some(_) => RowSelection::Triangles,
        };
        let (table, end) = PlyTable::open(source, header.encoding, element, at, selection)?;
        at = end;
        if let Some(slot) = slot(element) {
            tables[slot] = Some(table);
        }
    }
    Ok(tables)
}

/// A table that the file must have.
pub(super) fn required<'a>(
    table: Option<PlyTable<'a>>,
    source: &Source,
    name: &str,
) -> Result<PlyTable<'a>> {
    table.ok_or_else(|| Error::malformed(&source.path, "header", format!("has no element {name}")))
}

/// Only the rows of `vertex`: a cloud of points.
pub fn points<'a>(
    source: &'a Source,
    header: &'a PlyHeader,
    limits: &Limits,
) -> Result<PlyTable<'a>> {
    let [vertices] = open(source, header, ["vertex"], false, limits)?;
    required(vertices, source, "vertex")
}

impl<'a> PlyTable<'a> {
    /// The rows of `element`, which start at byte `at`, and the byte after the last one. The file
    /// is checked to be long enough for them.
    fn open(
        source: &'a Source,
        encoding: Encoding,
        element: &'a Element,
        at: u64,
        selection: RowSelection,
    ) -> Result<(Self, u64)> {
        let mut table = Self {
            path: &source.path,
            element,
            // Only rows without properties can be too many here, and these are not read.
            rows: usize::try_from(element.rows).unwrap_or(usize::MAX),
            stride: 0,
            columns: Vec::new(),
            corners: None,
            body: RowStorage::File(&source.file, at),
            polygons: Vec::new(),
            uv_numbers: Vec::new(),
            uv_ends: Vec::new(),
        };
        for property in &element.properties {
            match property.kind {
                PropertyType::Scalar(scalar) => {
                    let column = table.push(scalar, 1);
                    table.columns.push((&property.name, column));
                }
                PropertyType::List { count, item } if property.is_corner_list() => {
                    table.corners = Some((table.push(count, 1), table.push(item, 3)));
                }
                // Other lists take no room.
                PropertyType::List { .. } => {}
            }
        }
        if table.is_in_place(encoding, selection)
            && table.fits(source.len.saturating_sub(at), selection)?
        {
            let end = at + element.rows * table.stride as u64;
            return Ok((table, end));
        }
        let out = transcode::rows(source, encoding, element, at, selection)?;
        table.body = RowStorage::Memory(out.bytes);
        table.polygons = out.polygons;
        table.uv_numbers = out.uv_numbers;
        table.uv_ends = out.uv_ends;
        Ok((table, out.end))
    }

    fn push(&mut self, scalar: Scalar, count: usize) -> Column {
        let column = Column { offset: self.stride, scalar };
        self.stride += scalar.size() * count;
        column
    }

    /// True when every row takes `stride` bytes in the final form, as long as all faces are
    /// triangles.
    fn is_in_place(&self, encoding: Encoding, selection: RowSelection) -> bool {
        let is_list = |kind| matches!(kind, PropertyType::List { .. });
        let lists = self.element.properties.iter().filter(|p| is_list(p.kind)).count();
        let is_face = lists == 1 && self.corners.is_some() && self.element.name == "face";
        match encoding {
            Encoding::Ascii => false,
            Encoding::Big => lists == 0 && selection == RowSelection::Nothing,
            Encoding::Little => lists == 0 || is_face && selection != RowSelection::Nothing,
        }
    }

    /// True when `left` bytes hold all rows in this form. False for faces among which are polygons,
    /// which make rows longer, or which are cut short: [`super::transcode`] names the first bad
    /// one. If polygons are not permitted, faces are checked during reading.
    fn fits(&self, left: u64, selection: RowSelection) -> Result<bool> {
        let rows = self.element.rows;
        let stride = self.stride as u64;
        let enough = rows.checked_mul(stride).is_some_and(|bytes| bytes <= left);
        match self.corners {
            None if !enough => Err(self.malformed(format!(
                "promises {rows} rows of {stride} bytes, but only {left} bytes follow: cut short"
            ))),
            Some((count, _)) if enough && selection == RowSelection::Polygons => {
                let blocks = 0..self.rows.div_ceil(self.rows_per_block());
                let are_triangles =
                    self.blocks(blocks, |_, mut rows, _| Ok(rows.all(|row| count.int(row) == 3)))?;
                Ok(are_triangles.into_iter().all(|all| all))
            }
            _ => Ok(enough),
        }
    }

    /// The single number of that name, if the rows have one.
    pub fn find(&self, name: &str) -> Option<Column> {
        self.columns.iter().find(|(n, _)| *n == name).map(|(_, column)| *column)
    }

    /// The single number of that name, which the rows must have.
    pub fn column(&self, name: &str) -> Result<Column> {
        self.find(name).ok_or_else(|| self.malformed(format!("has no property {name}")))
    }

    /// The single numbers of these names.
    pub(super) fn columns<const N: usize>(&self, names: [&str; N]) -> Result<[Column; N]> {
        let mut columns = [Column { offset: 0, scalar: Scalar::U8 }; N];
        for (column, name) in columns.iter_mut().zip(names) {
            *column = self.column(name)?;
        }
        Ok(columns)
    }

    /// Red, green and blue of each SH coefficient above degree 0, and their degree, at most
    /// `highest`. The file has all of red first, then green, then blue, as 3DGS.
    pub(super) fn sh_columns(&self, highest: u8) -> Result<(Vec<[Column; 3]>, u8)> {
        let rest = self.element.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
        let count = |degree: u8| sh_count(degree) - 1;
        let Some(degree) = (0..=3u8).find(|d| 3 * count(*d) == rest) else {
            return Err(self.malformed(format!(
                "has {rest} properties f_rest_*; expected 0, 9, 24 or 45 (SH degree 0 to 3)"
            )));
        };
        let kept = degree.min(highest);
        let column = |channel: usize, k: usize| {
            self.column(&format!("f_rest_{}", channel * count(degree) + k))
        };
        let all = (0..count(kept)).map(|k| Ok([column(0, k)?, column(1, k)?, column(2, k)?]));
        Ok((all.collect::<Result<_>>()?, kept))
    }

    /// The error of a fault in the whole element.
    fn malformed(&self, reason: impl Into<String>) -> Error {
        Error::malformed(self.path, format!("element {}", self.element.name), reason)
    }

    /// The error of a fault in a row.
    pub(super) fn error(&self, row: usize, reason: impl Into<String>) -> Error {
        Error::malformed(self.path, format!("{} {row}", self.element.name), reason)
    }

    /// Rows that are read at once.
    pub(super) fn rows_per_block(&self) -> usize {
        (BLOCK / self.stride.max(1)).max(1)
    }

    /// Reads all rows on all threads: `read` gets the number of a block's first row, its rows and
    /// its part. The error is the first block's, so that it does not depend on threads.
    pub(super) fn blocks<P: Send, R: Send>(
        &self,
        parts: impl IntoIterator<Item = P>,
        read: impl Fn(usize, ChunksExact<'_, u8>, P) -> Result<R> + Sync,
    ) -> Result<Vec<R>> {
        let step = self.rows_per_block();
        let block = |buffer: &mut Vec<u8>, block: usize, part: P| {
            let first = block * step;
            let rows = self.block(first, step.min(self.rows - first), buffer)?;
            read(first, rows.chunks_exact(self.stride.max(1)), part)
        };
        parallel::map_with(parts, Vec::new, block).into_iter().collect()
    }

    /// Calls `each` with the number and bytes of every row, in order.
    ///
    /// # Errors
    ///
    /// Errors of the operating system and of `each`.
    pub fn each_row(&self, mut each: impl FnMut(usize, &[u8]) -> Result<()>) -> Result<()> {
        let step = self.rows_per_block();
        let mut buffer = Vec::new();
        for first in (0..self.rows).step_by(step) {
            let rows = self.block(first, step.min(self.rows - first), &mut buffer)?;
            let mut rows = rows.chunks_exact(self.stride.max(1)).enumerate();
            rows.try_for_each(|(i, row)| each(first + i, row))?;
        }
        Ok(())
    }

    /// `rows` rows from `first` on, read into `buffer` if they are not in memory.
    fn block<'b>(&'b self, first: usize, rows: usize, buffer: &'b mut Vec<u8>) -> Result<&'b [u8]> {
        let from = first * self.stride;
        let len = rows * self.stride;
        match &self.body {
            RowStorage::Memory(bytes) => Ok(&bytes[from..from + len]),
            RowStorage::File(file, offset) => {
                buffer.resize(len, 0);
                read_at(file, buffer, offset + from as u64).map_err(|e| Error::io(self.path, e))?;
                Ok(buffer)
            }
        }
    }

    /// The origin to subtract from every position: zero, except for double positions far from the
    /// origin.
    pub(super) fn origin(&self) -> Result<DVec3> {
        let axes = self.columns(["x", "y", "z"])?;
        if !axes.iter().any(|axis| axis.scalar == Scalar::F64) {
            return Ok(DVec3::ZERO);
        }
        let mut buffer = Vec::new();
        let mut position = |row: usize| {
            let row = self.block(row, 1, &mut buffer)?;
            Ok(DVec3::from(axes.map(|axis| axis.f64(row))))
        };
        Ok(origin_of(sampled(self.rows).map(&mut position).collect::<Result<_>>()?))
    }

    /// Reads x, y, z of every vertex, relative to `origin`. `[V]`
    pub(super) fn read_positions(&self, origin: DVec3, out: &mut [Vec3]) -> Result<()> {
        let axes = self.columns(["x", "y", "z"])?;
        if let RowStorage::File(file, start) = self.body
            && origin == DVec3::ZERO
            && self.has_rows_like_memory(axes)
        {
            return self.read_like_memory(file, start, out);
        }
        self.blocks(out.chunks_mut(self.rows_per_block()), |_, rows, out| {
            for (row, out) in rows.zip(out) {
                *out = match origin {
                    DVec3::ZERO => Vec3::from(axes.map(|axis| axis.f32(row))),
                    _ => (DVec3::from(axes.map(|axis| axis.f64(row))) - origin).as_vec3(),
                };
            }
            Ok(())
        })?;
        Ok(())
    }

    /// True if a row is the bytes of a position in memory.
    fn has_rows_like_memory(&self, axes: [Column; 3]) -> bool {
        let is_in_place = |axis: usize| {
            axes[axis].scalar == Scalar::F32 && axes[axis].offset == axis * size_of::<f32>()
        };
        cfg!(target_endian = "little")
            && self.stride == size_of::<Vec3>()
            && (0..3).all(is_in_place)
    }

    /// Reads rows that are the bytes of positions, which begin at byte `start`.
    fn read_like_memory(&self, file: &File, start: u64, out: &mut [Vec3]) -> Result<()> {
        let step = self.rows_per_block();
        let read = |block: usize, out: &mut [Vec3]| {
            let offset = start + (block * step * self.stride) as u64;
            read_at(file, bytemuck::cast_slice_mut(out), offset)
        };
        let blocks: io::Result<Vec<()>> =
            parallel::map(out.chunks_mut(step), read).into_iter().collect();
        blocks.map(drop).map_err(|e| Error::io(self.path, e))
    }

    /// True if the corners of a face are the three vertices behind those of the faces before it.
    #[inline]
    pub(super) fn has_own_corners(&self, face: usize, row: &[u8]) -> bool {
        let Some((count, first)) = self.corners else { return false };
        let size = first.scalar.size();
        let is_own = |i: usize| {
            let corner = Column { offset: first.offset + i * size, ..first };
            corner.int(row) == (3 * face + i) as i64
        };
        first.scalar.is_integer() && count.int(row) == 3 && (0..3).all(is_own)
    }

    /// The first three corners of all faces, each below `vertices`. `[F * 3]`
    pub(super) fn triangles(&self, vertices: usize, limits: &Limits) -> Result<Vec<u32>> {
        let corners = self.corners;
        let (count, first) =
            corners.ok_or_else(|| self.malformed("has no list vertex_indices or vertex_index"))?;
        if !first.scalar.is_integer() {
            return Err(self.malformed("has float corner numbers; expected an integer type"));
        }
        let corners =
            [0, 1, 2].map(|i| Column { offset: first.offset + i * first.scalar.size(), ..first });
        let mut indices = limits.zeroed::<u32>(self.path.display(), self.rows * 3)?;
        self.blocks(indices.chunks_mut(3 * self.rows_per_block()), |face, rows, out| {
            for (i, (row, out)) in rows.zip(out.as_chunks_mut::<3>().0).enumerate() {
                if count.int(row) != 3 {
                    return Err(self.error(face + i, not_a_triangle(count.int(row))));
                }
                for (out, corner) in out.iter_mut().zip(corners) {
                    *out = self.vertex(face + i, corner.int(row), vertices)?;
                }
            }
            Ok(())
        })?;
        Ok(indices)
    }

    #[inline]
    fn vertex(&self, face: usize, corner: i64, vertices: usize) -> Result<u32> {
        match u32::try_from(corner) {
            Ok(vertex) if (vertex as usize) < vertices => Ok(vertex),
            _ => {
                let reason = format!("names vertex {corner}, but there are {vertices} vertices");
                Err(self.error(face, reason))
            }
        }
    }

    /// The texture coordinates that faces list for their corners, which are below `vertices`.
    pub(super) fn corner_uvs(&self, vertices: usize, limits: &Limits) -> Result<CornerUvs> {
        let mut corner_uvs = CornerUvs::default();
        if self.uv_ends.is_empty() {
            return Ok(corner_uvs);
        }
        let indices = self.triangles(vertices, limits)?;
        let mut first = 0;
        let mut polygons = self.polygons.iter().peekable();
        for ((face, triangle), end) in indices.chunks_exact(3).enumerate().zip(&self.uv_ends) {
            let corners = match polygons.next_if(|(polygon, _)| *polygon == face) {
                Some((_, listed)) => listed.iter().map(|corner| *corner as u32).collect(),
                None => triangle.to_vec(),
            };
            for (vertex, place) in
                corners.into_iter().zip(self.uv_numbers[first..*end].as_chunks::<2>().0)
            {
                corner_uvs.push(face, vertex, corner_uvs.uvs.len() as u32);
                corner_uvs.uvs.push(Vec2::from(*place));
            }
            corner_uvs.end_face();
            first = *end;
        }
        Ok(corner_uvs)
    }

    /// All faces, their corners below `vertices`.
    pub(super) fn faces(&self, vertices: usize, limits: &Limits) -> Result<FaceList> {
        let indices = self.triangles(vertices, limits)?;
        if self.polygons.is_empty() {
            return Ok(FaceList::from_triangles(indices));
        }
        let mut out = FaceList::default();
        let mut polygons = self.polygons.iter().peekable();
        for (face, triangle) in indices.chunks_exact(3).enumerate() {
            let pushed = match polygons.next_if(|(polygon, _)| *polygon == face) {
                Some((_, listed)) => {
                    let corners = listed.iter().map(|corner| self.vertex(face, *corner, vertices));
                    out.push(&corners.collect::<Result<Vec<u32>>>()?)
                }
                None => out.push(triangle),
            };
            pushed.map_err(|reason| self.error(face, reason))?;
            limits.triangles(self.path.display(), out.triangles() as u64)?;
        }
        Ok(out)
    }
}

#[cfg(unix)]
fn read_at(file: &File, out: &mut [u8], offset: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, out, offset)
}

/// Elsewhere one thread at a time seeks and reads.
#[cfg(not(unix))]
fn read_at(mut file: &File, out: &mut [u8], offset: u64) -> std::io::Result<()> {
    use std::io::{Read, Seek, SeekFrom};
    static TURN: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _turn = TURN.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    file.seek(SeekFrom::Start(offset))?;
    file.read_exact(out)
}

// ---- What both PLY writers share ----------------------------------------------------------------

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
