//! Vertices and corner numbers of a PLY, checked.

use super::header::Column;
use super::header::{Element, Header, Scalar};
use super::table::Table;
use crate::faces::{Faces, not_a_triangle};
use crate::finish::{origin_of, sampled};
use crate::lines::write_blocks;
use glam::{DVec3, Mat3, UVec2, Vec2, Vec3};
use std::io;
use std::io::Write;
use std::path::Path;
use trisplat_scene::camera::Camera;
use trisplat_scene::{Limits, Result, parallel};

/// The origin to subtract from every position: zero, except for double positions far from the origin.
pub(super) fn origin(vertices: &Table) -> Result<DVec3> {
    let axes = axes(vertices)?;
    let position = |row: &[u8]| DVec3::from(axes.map(|axis| axis.f64(row)));
    if !axes.iter().any(|axis| axis.scalar == Scalar::F64) {
        return Ok(DVec3::ZERO);
    }
    let mut buffer = Vec::new();
    let sample = sampled(vertices.rows()).map(|row| Ok(position(vertices.block(row, 1, &mut buffer)?)));
    Ok(origin_of(sample.collect::<Result<_>>()?))
}

fn axes(vertices: &Table) -> Result<[Column; 3]> {
    Ok([vertices.column("x")?, vertices.column("y")?, vertices.column("z")?])
}

/// Reads x, y, z of every vertex, relative to `origin`. // out: [V]
pub(super) fn read_positions(vertices: &Table, origin: DVec3, out: &mut [Vec3]) -> Result<()> {
    let axes = axes(vertices)?;
    let float = |i: usize| axes[i].scalar == Scalar::F32 && axes[i].offset == 4 * i;
    let in_place = cfg!(target_endian = "little") && vertices.stride() == 12 && (0..3).all(float);
    let per_block = vertices.rows_per_block();
    let read = |buffer: &mut Vec<u8>, block: usize, out: &mut [Vec3]| {
        if in_place {
            return vertices.fill(block * per_block, bytemuck::cast_slice_mut(out));
        }
        let rows = vertices.block(block * per_block, out.len(), buffer)?;
        for (row, out) in rows.chunks_exact(vertices.stride()).zip(out) {
            *out = match origin {
                DVec3::ZERO => Vec3::from(axes.map(|axis| axis.f32(row))),
                _ => (DVec3::from(axes.map(|axis| axis.f64(row))) - origin).as_vec3(),
            };
        }
        Ok(())
    };
    first_error(parallel::map_with(out.chunks_mut(per_block), Vec::new, read))
}

/// The place of a face's corner numbers in its row.
#[derive(Clone, Copy)]
pub(super) struct Corners {
    count: Column,
    first: Column,
}

impl Corners {
    pub(super) fn of(faces: &Table) -> Result<Self> {
        let (count, first) = faces.corners()?;
        Ok(Self { count, first })
    }

    /// True when the rows from face `face` on list the corners 0, 1, 2, 3, … without sharing. An error names
    /// the first face that is not a triangle.
    pub(super) fn are_unshared(self, faces: &Table, rows: &[u8], face: usize) -> Result<bool> {
        if self.are_usual(faces, rows, face) {
            return Ok(true);
        }
        let rows = || rows.chunks_exact(faces.stride()).enumerate();
        let plain = |(i, row): (usize, &[u8])| {
            let next = 3 * (face + i) as i64;
            self.count.int(row) == 3 && self.raw(row) == [next, next + 1, next + 2]
        };
        if rows().fold(true, |all, row| all & plain(row)) {
            return Ok(true);
        }
        match rows().find(|(_, row)| self.count.int(row) != 3) {
            Some((i, row)) => Err(faces.error(face + i, not_a_triangle(self.count.int(row)))),
            None => Ok(false),
        }
    }

    /// The same for the usual types, a byte and three words; false for others.
    fn are_usual(self, faces: &Table, rows: &[u8], face: usize) -> bool {
        let words = matches!(self.first.scalar, Scalar::I32 | Scalar::U32) && self.count.is_byte();
        let last = 3 * (face + rows.len() / faces.stride());
        let (Ok(_), true) = (i32::try_from(last), words) else { return false };
        let (count, first) = (self.count.offset, self.first.offset);
        let usual = |(i, row): (usize, &[u8])| {
            let next = 3 * (face + i) as u32;
            let mut listed = [0; 12];
            listed.copy_from_slice(&row[first..first + 12]);
            let wanted = [next, next + 1, next + 2].map(u32::to_le_bytes);
            row[count] == 3 && listed == wanted.as_flattened()
        };
        rows.chunks_exact(faces.stride()).enumerate().fold(true, |all, row| all & usual(row))
    }

    /// The corner numbers of one face, each checked to be below `vertices`.
    pub(super) fn checked(self, faces: &Table, row: &[u8], face: usize, vertices: usize) -> Result<[u32; 3]> {
        if self.count.int(row) != 3 {
            return Err(faces.error(face, not_a_triangle(self.count.int(row))));
        }
        let corners = self.raw(row);
        match corners.iter().find(|c| !is_vertex(**c, vertices)) {
            Some(c) => Err(faces.error(face, no_vertex(*c, vertices))),
            None => Ok(corners.map(|c| c as u32)),
        }
    }

    #[inline]
    fn raw(self, row: &[u8]) -> [i64; 3] {
        let Column { offset, scalar } = self.first;
        [0, 1, 2].map(|i| Column { offset: offset + i * scalar.size(), scalar }.int(row))
    }
}

/// All faces, their corner numbers below `vertices`.
pub(super) fn read_faces(faces: &Table, vertices: usize, path: &Path, limits: &Limits) -> Result<Faces> {
    let indices = read_triangles(faces, vertices, path, limits)?;
    let mut polygons = faces.polygons().iter().peekable();
    if polygons.peek().is_none() {
        return Ok(Faces::from_triangles(indices));
    }
    let (mut out, mut corners) = (Faces::default(), Vec::new());
    for (face, triangle) in indices.chunks_exact(3).enumerate() {
        corners.clear();
        match polygons.next_if(|(polygon, _)| *polygon == face) {
            Some((_, listed)) => {
                if let Some(c) = listed.iter().find(|c| !is_vertex(**c, vertices)) {
                    return Err(faces.error(face, no_vertex(*c, vertices)));
                }
                corners.extend(listed.iter().map(|c| *c as u32));
            }
            None => corners.extend_from_slice(triangle),
        }
        out.push(&corners).map_err(|reason| faces.error(face, reason))?;
        limits.triangles(path.display(), out.triangles() as u64)?;
    }
    Ok(out)
}

#[inline]
fn is_vertex(corner: i64, vertices: usize) -> bool {
    0 <= corner && corner < vertices as i64
}

fn no_vertex(corner: i64, vertices: usize) -> String {
    format!("names vertex {corner}, but there are {vertices} vertices")
}

/// The first three corner numbers of all faces. `[F * 3]`
fn read_triangles(faces: &Table, vertices: usize, path: &Path, limits: &Limits) -> Result<Vec<u32>> {
    let corners = Corners::of(faces)?;
    let mut indices = limits.zeroed::<u32>(path.display(), faces.rows() * 3)?;
    let per_block = faces.rows_per_block();
    let read = |buffer: &mut Vec<u8>, block: usize, out: &mut [u32]| {
        let first = block * per_block;
        let rows = faces.block(first, out.len() / 3, buffer)?;
        for (i, (row, out)) in rows.chunks_exact(faces.stride()).zip(out.chunks_exact_mut(3)).enumerate() {
            out.copy_from_slice(&corners.checked(faces, row, first + i, vertices)?);
        }
        Ok(())
    };
    first_error(parallel::map_with(indices.chunks_mut(3 * per_block), Vec::new, read))?;
    Ok(indices)
}

/// The error of the first block, so that the message does not depend on threads.
pub(super) fn first_error<T: Default>(blocks: Vec<Result<T>>) -> Result<()> {
    blocks.into_iter().try_for_each(|block| block.map(|_| ()))
}

// ---- The element `view` of a soup PLY: the cameras of its photos ----------------------------------

pub(super) const NAME: &str = "view";
/// R by rows, t, focal lengths and principal point; then the size, as integers.
const FLOATS: [&str; 16] =
    ["r00", "r01", "r02", "r10", "r11", "r12", "r20", "r21", "r22", "tx", "ty", "tz", "fx", "fy", "cx", "cy"];
const WHOLE: [&str; 2] = ["width", "height"];

/// The element, if it exists with all properties of a camera.
pub(super) fn element(header: &Header) -> Option<&Element> {
    header.element(NAME).filter(|e| FLOATS.iter().chain(&WHOLE).all(|p| e.has(p)))
}

/// The element's lines in the header; none without cameras.
pub(super) fn header(cameras: &[Camera]) -> String {
    if cameras.is_empty() {
        return String::new();
    }
    let mut header = format!("element {NAME} {}\n", cameras.len());
    FLOATS.iter().for_each(|name| header += &format!("property float {name}\n"));
    WHOLE.iter().for_each(|name| header += &format!("property uint {name}\n"));
    header
}

/// Writes the rows.
pub(super) fn write(out: &mut dyn Write, cameras: &[Camera]) -> io::Result<()> {
    write_blocks(out, cameras.len(), |i, block| {
        let Camera { rotation, translation, focal, center, size } = cameras[i];
        let rows = rotation.transpose().to_cols_array();
        let rest = translation.to_array().into_iter().chain(focal.to_array()).chain(center.to_array());
        rows.into_iter().chain(rest).for_each(|x| block.extend_from_slice(&x.to_le_bytes()));
        size.to_array().into_iter().for_each(|n| block.extend_from_slice(&n.to_le_bytes()));
    })
}

/// The cameras. An error names the first row that is invalid, or whose pictures are too large.
pub(super) fn read(table: &Table, limits: &Limits) -> Result<Vec<Camera>> {
    let columns = |names: &[&str]| names.iter().map(|n| table.column(n)).collect::<Result<Vec<Column>>>();
    let (floats, whole) = (columns(&FLOATS)?, columns(&WHOLE)?);
    let (mut cameras, mut buffer) = (Vec::new(), Vec::new());
    let step = table.rows_per_block();
    for first in (0..table.rows()).step_by(step) {
        let rows = table.block(first, step.min(table.rows() - first), &mut buffer)?;
        for (i, row) in rows.chunks_exact(table.stride()).enumerate() {
            let mut x = [0.0; FLOATS.len()];
            x.iter_mut().zip(&floats).for_each(|(x, column)| *x = column.f32(row));
            let mut size = [0; WHOLE.len()];
            size.iter_mut().zip(&whole).for_each(|(n, c)| *n = u32::try_from(c.int(row)).unwrap_or(0));
            let [rotation @ .., tx, ty, tz, fx, fy, cx, cy] = x;
            let camera = Camera {
                rotation: Mat3::from_cols_array(&rotation).transpose(),
                translation: Vec3::new(tx, ty, tz),
                focal: Vec2::new(fx, fy),
                center: Vec2::new(cx, cy),
                size: UVec2::from(size),
            };
            limits.camera(table.place(first + i), camera.size)?;
            let turns = (camera.rotation.determinant() - 1.0).abs() < 0.01;
            if camera.validate(limits).is_err() || !turns {
                let wants =
                    "is no camera: expected finite numbers, a rotation, focal lengths and a size above 0";
                return Err(table.error(first + i, wants));
            }
            cameras.push(camera);
        }
    }
    Ok(cameras)
}
