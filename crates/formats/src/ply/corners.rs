//! Vertices and corner numbers of a PLY, checked.

use super::column::Column;
use super::header::Scalar;
use super::table::Table;
use crate::faces::{Faces, not_a_triangle};
use crate::far::{origin_of, sampled};
use glam::{DVec3, Vec3};
use std::path::Path;
use trisplat_scene::parallel;
use trisplat_scene::{Limits, Result};

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
