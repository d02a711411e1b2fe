//! The soup PLY: our own file of a trained scene, and a valid triangle mesh. See `docs/soup-ply.md`.

use super::corners;
use super::corners::{Corners, first_error, read_positions};
use super::header::Column;
use super::header::{Element, Scalar};
use super::table;
use super::table::Table;
use super::tables::Tables;
use crate::ReadOptions;
use crate::lines::to_comment;
use crate::lines::write_blocks;
use glam::{DVec3, Vec3};
use std::io::{self, Write};
use std::path::Path;
use trisplat_scene::parallel;
use trisplat_scene::{Error, Limits, Provenance, Result, Soup, camera::Camera, rgb_from_sh0};

/// The property of a face that is 1 for the shell; files without a shell lack it.
const SHELL: &str = "shell";

/// True when the faces have the properties of a soup.
pub(super) fn is_soup(faces: &Element) -> bool {
    faces.has("sigma")
}

/// The soup, relative to `origin`, with SH up to `options.sh_degree`; higher degrees are skipped.
pub(super) fn read(
    path: &Path,
    element: &Element,
    tables: &Tables,
    origin: DVec3,
    options: &ReadOptions,
) -> Result<Soup> {
    let Tables { vertices, faces, .. } = tables;
    let columns = Columns::of(path, element, faces, options.sh_degree)?;
    for axis in ["x", "y", "z"] {
        vertices.column(axis)?;
    }
    let (count, limits) = (faces.rows(), &options.limits);
    let mut soup = Soup {
        vertices: Vec::new(),
        opacity: limits.zeroed(path.display(), count)?,
        sigma: limits.zeroed(path.display(), count)?,
        sh: limits.zeroed(path.display(), count * columns.sh.len())?,
        sh_degree: columns.sh_degree,
        shell: Vec::new(),
    };
    let unshared = columns.read(faces, &mut soup)?;
    soup.shell = read_shell(faces, limits, path)?;
    soup.vertices = if unshared && vertices.rows() == 3 * count {
        let mut own = limits.zeroed::<[Vec3; 3]>(path.display(), count)?;
        read_positions(vertices, origin, bytemuck::cast_slice_mut(&mut own))?;
        own
    } else {
        gather(vertices, origin, faces, limits, path)?
    };
    Ok(soup)
}

/// Flags of the shell's faces; empty when none is set.
fn read_shell(faces: &Table, limits: &Limits, path: &Path) -> Result<Vec<bool>> {
    let Some(column) = faces.find(SHELL) else { return Ok(Vec::new()) };
    let mut shell = limits.zeroed::<u8>(path.display(), faces.rows())?;
    let per_block = faces.rows_per_block();
    let read = |buffer: &mut Vec<u8>, block: usize, out: &mut [u8]| {
        let rows = faces.block(block * per_block, out.len(), buffer)?;
        rows.chunks_exact(faces.stride())
            .zip(out)
            .for_each(|(row, out)| *out = u8::from(column.f32(row) != 0.0));
        Ok(())
    };
    first_error(parallel::map_with(shell.chunks_mut(per_block), Vec::new, read))?;
    Ok(if shell.contains(&1) { shell.into_iter().map(|flag| flag == 1).collect() } else { Vec::new() })
}

/// The corners of every face, looked up among shared vertices.
fn gather(
    vertices: &Table,
    origin: DVec3,
    faces: &Table,
    limits: &Limits,
    path: &Path,
) -> Result<Vec<[Vec3; 3]>> {
    let mut shared = limits.zeroed::<Vec3>(path.display(), vertices.rows())?;
    read_positions(vertices, origin, &mut shared)?;
    let corners = Corners::of(faces)?;
    let mut own = limits.zeroed::<[Vec3; 3]>(path.display(), faces.rows())?;
    let per_block = faces.rows_per_block();
    let read = |buffer: &mut Vec<u8>, block: usize, out: &mut [[Vec3; 3]]| {
        let first = block * per_block;
        let rows = faces.block(first, out.len(), buffer)?;
        for (i, (row, out)) in rows.chunks_exact(faces.stride()).zip(out).enumerate() {
            let face = corners.checked(faces, row, first + i, shared.len())?;
            *out = face.map(|v| shared[v as usize]);
        }
        Ok(())
    };
    first_error(parallel::map_with(own.chunks_mut(per_block), Vec::new, read))?;
    Ok(own)
}

/// The places of a soup's numbers in a face's row.
struct Columns {
    corners: Corners,
    opacity: Column,
    sigma: Column,
    /// Red, green and blue of each requested coefficient. `[K]`
    sh: Vec<[Column; 3]>,
    sh_degree: u8,
}

impl Columns {
    fn of(path: &Path, element: &Element, faces: &Table, highest: u8) -> Result<Self> {
        let rest = element.properties.iter().filter(|p| p.name.starts_with("f_rest_")).count();
        let Some(degree) = (0..=3u8).find(|d| 3 * (sh_count(*d) - 1) == rest) else {
            let reason =
                format!("has {rest} properties f_rest_*; expected 0, 9, 24 or 45 (SH degree 0 to 3)");
            return Err(Error::malformed(path, "element face", reason));
        };
        let sh_degree = degree.min(highest);
        // 3DGS order: all of red, then all of green, then all of blue.
        let name = |k: usize, channel: usize| match k {
            0 => format!("f_dc_{channel}"),
            _ => format!("f_rest_{}", channel * (sh_count(degree) - 1) + k - 1),
        };
        let coefficient = |k: usize| -> Result<[Column; 3]> {
            Ok([faces.column(&name(k, 0))?, faces.column(&name(k, 1))?, faces.column(&name(k, 2))?])
        };
        Ok(Self {
            corners: Corners::of(faces)?,
            opacity: faces.column("opacity")?,
            sigma: faces.column("sigma")?,
            sh: (0..sh_count(sh_degree)).map(coefficient).collect::<Result<_>>()?,
            sh_degree,
        })
    }

    /// Fills everything except the vertices; true when the corners are 0, 1, 2, 3, …
    fn read(&self, faces: &Table, soup: &mut Soup) -> Result<bool> {
        let (per_block, k) = (faces.rows_per_block(), self.sh.len());
        let parts = soup
            .opacity
            .chunks_mut(per_block)
            .zip(soup.sigma.chunks_mut(per_block))
            .zip(soup.sh.chunks_mut(per_block * k));
        let blocks: Vec<Result<bool>> =
            parallel::map_with(parts, Vec::new, |buffer, block, ((opacity, sigma), sh)| {
                let rows = faces.block(block * per_block, opacity.len(), buffer)?;
                let unshared = self.corners.are_unshared(faces, rows, block * per_block)?;
                copy_column(self.opacity, rows, faces.stride(), opacity);
                copy_column(self.sigma, rows, faces.stride(), sigma);
                self.copy_sh(rows, faces.stride(), sh);
                Ok(unshared)
            });
        blocks.into_iter().try_fold(true, |all, block| Ok(all & block?))
    }

    fn copy_sh(&self, rows: &[u8], stride: usize, out: &mut [[f32; 3]]) {
        let floats = self.sh.iter().flatten().all(|c| c.scalar == Scalar::F32);
        for (row, out) in rows.chunks_exact(stride).zip(out.chunks_exact_mut(self.sh.len())) {
            for (columns, out) in self.sh.iter().zip(out) {
                *out =
                    if floats { columns.map(|c| float(row, c.offset)) } else { columns.map(|c| c.f32(row)) };
            }
        }
    }
}

fn copy_column(column: Column, rows: &[u8], stride: usize, out: &mut [f32]) {
    let floats = column.scalar == Scalar::F32;
    for (row, out) in rows.chunks_exact(stride).zip(out) {
        *out = if floats { float(row, column.offset) } else { column.f32(row) };
    }
}

#[inline]
fn float(row: &[u8], offset: usize) -> f32 {
    let mut bytes = [0; 4];
    bytes.copy_from_slice(&row[offset..offset + 4]);
    f32::from_le_bytes(bytes)
}

fn sh_count(degree: u8) -> usize {
    (degree as usize + 1).pow(2)
}

/// Writes a soup PLY: binary little-endian, three separate vertices per triangle. `cameras` are those of its
/// photos, in its frame; the list may be empty.
///
/// Errors are those of `out`, and `InvalidInput` above 715,827,882 triangles, where PLY's `int` corner
/// numbers end. It neither flushes nor renames.
pub fn write_soup(
    out: &mut dyn Write,
    soup: &Soup,
    provenance: &Provenance,
    cameras: &[Camera],
) -> io::Result<()> {
    let shell = soup.shell_count() > 0;
    let mut writer = SoupWriter::start(out, soup.len(), soup.sh_degree, provenance, cameras, shell)?;
    writer.vertices(soup)?;
    writer.faces(soup)?;
    writer.end(cameras)
}

/// Writes a soup PLY of several soups, in order, without holding all in memory: first the corners of each,
/// then the rest of each.
pub struct SoupWriter<'a> {
    out: &'a mut dyn Write,
    /// Triangles that are to come.
    corners_left: usize,
    /// Number of completely written triangles.
    written: usize,
    count: usize,
    sh_degree: u8,
    shell: bool,
}

impl<'a> SoupWriter<'a> {
    /// Begins a file of `count` triangles with colours of `sh_degree`; `shell` when some of them are the shell.
    ///
    /// Errors: as for [`write_soup`].
    pub fn start(
        out: &'a mut dyn Write,
        count: usize,
        sh_degree: u8,
        provenance: &Provenance,
        cameras: &[Camera],
        shell: bool,
    ) -> io::Result<Self> {
        if count > i32::MAX as usize / 3 {
            return Err(io::Error::new(io::ErrorKind::InvalidInput, "too many triangles for a PLY file"));
        }
        out.write_all(header(count, sh_degree, provenance, cameras, shell).as_bytes())?;
        Ok(Self { out, corners_left: count, written: 0, count, sh_degree, shell })
    }

    /// The corners of the next soup.
    ///
    /// Errors: as for [`write_soup`]; more triangles than were announced.
    pub fn vertices(&mut self, soup: &Soup) -> io::Result<()> {
        self.corners_left = self.corners_left.checked_sub(soup.len()).ok_or_else(other_count)?;
        table::write_floats(self.out, bytemuck::cast_slice(&soup.vertices))
    }

    /// The rest of the next soup, once the corners of all were written.
    ///
    /// Errors: as for [`write_soup`]; other triangles than were announced, or colours of another degree.
    pub fn faces(&mut self, soup: &Soup) -> io::Result<()> {
        let fits =
            self.written + soup.len() <= self.count && (soup.sh_degree == self.sh_degree || soup.is_empty());
        if self.corners_left > 0 || !fits {
            return Err(other_count());
        }
        let (k, first) = (soup.sh_count(), self.written);
        self.written += soup.len();
        write_blocks(self.out, soup.len(), |i, block| {
            let sh = &soup.sh[i * k..(i + 1) * k];
            let corner = 3 * (first + i) as u32;
            table::push_corners(block, [corner, corner + 1, corner + 2]);
            let rest = (0..3).flat_map(|channel| sh[1..].iter().map(move |c| c[channel]));
            for value in [soup.opacity[i], soup.sigma[i]].into_iter().chain(sh[0]).chain(rest) {
                block.extend_from_slice(&value.to_le_bytes());
            }
            block.extend_from_slice(&sh[0].map(|c| (255.0 * rgb_from_sh0(c)).round() as u8));
            if self.shell {
                block.push(u8::from(soup.is_shell(i)));
            }
        })
    }

    /// Writes the part after all triangles.
    ///
    /// Errors: as for [`write_soup`]; fewer triangles than were announced.
    pub fn end(self, cameras: &[Camera]) -> io::Result<()> {
        if self.written < self.count {
            return Err(other_count());
        }
        corners::write(self.out, cameras)
    }
}

fn other_count() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "other triangles than were announced")
}

fn header(count: usize, sh_degree: u8, provenance: &Provenance, cameras: &[Camera], shell: bool) -> String {
    let mut header = String::from("ply\nformat binary_little_endian 1.0\ncomment trisplat soup 1\n");
    table::push_comment(&mut header, &to_comment(provenance));
    header += &format!("element vertex {}\n", 3 * count);
    for axis in ["x", "y", "z"] {
        header += &format!("property float {axis}\n");
    }
    header += &format!("element face {}\nproperty list uchar int vertex_indices\n", count);
    let rest = (0..3 * (sh_count(sh_degree) - 1)).map(|i| format!("f_rest_{i}"));
    let names = ["opacity", "sigma", "f_dc_0", "f_dc_1", "f_dc_2"].map(String::from);
    for name in names.into_iter().chain(rest) {
        header += &format!("property float {name}\n");
    }
    for channel in ["red", "green", "blue"] {
        header += &format!("property uchar {channel}\n");
    }
    if shell {
        header += &format!("property uchar {SHELL}\n");
    }
    header + &corners::header(cameras) + "end_header\n"
}
