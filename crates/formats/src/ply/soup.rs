//! The soup PLY: our own file of a trained scene, and a valid triangle mesh. See
//! `docs/soup-ply.md`.

use super::header::{Column, Element, PlyHeader};
use super::table::{self, PlyTable};
use crate::ReadOptions;
use crate::lines::{to_comment, write_blocks};
use glam::{DVec3, Mat3, UVec2, Vec2, Vec3};
use std::io::{self, Write};
use std::slice::ChunksExact;
use trisplat_scene::camera::Camera;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Limits, Provenance, Result, Soup, rgb_from_sh0, sh_count};

/// The property of a face that is 1 for the shell; files without a shell lack it.
const SHELL: &str = "shell";

/// True when the faces have the properties of a soup.
pub(super) fn is_soup(faces: &Element) -> bool {
    faces.has("sigma")
}

/// The soup, relative to `origin`, with SH up to `options.sh_degree`; higher degrees are skipped.
pub(super) fn read(
    vertices: &PlyTable,
    faces: &PlyTable,
    origin: DVec3,
    options: &ReadOptions,
) -> Result<Soup> {
    let (higher, sh_degree) = faces.sh_columns(options.sh_degree)?;
    let [opacity, sigma] = faces.columns(["opacity", "sigma"])?;
    let mut columns = vec![faces.columns(["f_dc_0", "f_dc_1", "f_dc_2"])?];
    columns.extend(higher);
    let count = faces.rows;
    let k = columns.len();
    let limits = &options.limits;
    let path = faces.path.display();
    let mut soup = Soup {
        vertices: limits.zeroed(&path, count)?,
        opacity: limits.zeroed(&path, count)?,
        sigma: limits.zeroed(&path, count)?,
        sh: limits.zeroed(&path, count * k)?,
        sh_degree,
        shell: Vec::new(),
    };
    let step = faces.rows_per_block();
    let parts = soup.opacity.chunks_mut(step).zip(soup.sigma.chunks_mut(step));
    let own_corners = faces.blocks(
        parts.zip(soup.sh.chunks_mut(step * k)),
        |face, rows, ((opacities, sigmas), sh)| {
            let mut own_corners = true;
            for (i, row) in rows.enumerate() {
                own_corners &= faces.has_own_corners(face + i, row);
                opacities[i] = opacity.f32(row);
                sigmas[i] = sigma.f32(row);
                for (out, columns) in sh[i * k..].iter_mut().zip(&columns) {
                    *out = columns.map(|column| column.f32(row));
                }
            }
            Ok(own_corners)
        },
    )?;
    if let Some(column) = faces.find(SHELL) {
        let flags = |_: usize, rows: ChunksExact<'_, u8>, _: usize| {
            Ok(rows.map(|row| column.f32(row) != 0.0).collect::<Vec<bool>>())
        };
        soup.shell = faces.blocks(0..count.div_ceil(step), flags)?.concat();
        if !soup.shell.contains(&true) {
            soup.shell = Vec::new();
        }
    }
    if vertices.rows == 3 * count && own_corners.into_iter().all(|own| own) {
        vertices.read_positions(origin, soup.vertices.as_flattened_mut())?;
    } else {
        let indices = faces.triangles(vertices.rows, limits)?;
        let mut shared = limits.zeroed::<Vec3>(&path, vertices.rows)?;
        vertices.read_positions(origin, &mut shared)?;
        let corners = indices.as_chunks::<3>().0;
        parallel::for_each_mut(&mut soup.vertices, GRAIN, |face, out| {
            *out = corners[face].map(|vertex| shared[vertex as usize]);
        });
    }
    Ok(soup)
}

/// Writes a soup PLY: binary little-endian, three separate vertices per triangle. `cameras` are
/// the cameras of its photos, in its frame; the list may be empty. It neither flushes nor renames.
///
/// # Errors
///
/// Errors of `out`, and `InvalidInput` above 715,827,882 triangles, where PLY's `int` corner
/// numbers end.
pub fn write_soup(
    out: &mut dyn Write,
    soup: &Soup,
    provenance: &Provenance,
    cameras: &[Camera],
) -> io::Result<()> {
    let shell = soup.shell_count() > 0;
    let mut writer =
        SoupWriter::start(out, soup.len(), soup.sh_degree, provenance, cameras, shell)?;
    writer.vertices(soup)?;
    writer.faces(soup)?;
    writer.end(cameras)
}

/// Writes a soup PLY of several soups, in order, without holding all in memory: first the corners
/// of each, then the rest of each.
pub struct SoupWriter<'a> {
    out: &'a mut dyn Write,
    /// Number of triangles whose corners are not written yet.
    corners_left: usize,
    /// Number of completely written triangles.
    written: usize,
    count: usize,
    sh_degree: u8,
    shell: bool,
}

impl<'a> SoupWriter<'a> {
    /// Begins a file of `count` triangles with colours of `sh_degree`; `shell` when some of them
    /// are the shell.
    ///
    /// # Errors
    ///
    /// As for [`write_soup`].
    pub fn start(
        out: &'a mut dyn Write,
        count: usize,
        sh_degree: u8,
        provenance: &Provenance,
        cameras: &[Camera],
        shell: bool,
    ) -> io::Result<Self> {
        if count > i32::MAX as usize / 3 {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                "too many triangles for a PLY file",
            ));
        }
        out.write_all(header(count, sh_degree, provenance, cameras, shell).as_bytes())?;
        Ok(Self { out, corners_left: count, written: 0, count, sh_degree, shell })
    }

    /// The corners of the next soup.
    ///
    /// # Errors
    ///
    /// As for [`write_soup`]; more triangles than were announced.
    pub fn vertices(&mut self, soup: &Soup) -> io::Result<()> {
        self.corners_left = self.corners_left.checked_sub(soup.len()).ok_or_else(wrong_count)?;
        table::write_floats(self.out, bytemuck::cast_slice(&soup.vertices))
    }

    /// The rest of the next soup, once the corners of all were written.
    ///
    /// # Errors
    ///
    /// As for [`write_soup`]; other triangles than were announced, or colours of another degree.
    pub fn faces(&mut self, soup: &Soup) -> io::Result<()> {
        let fits = self.written + soup.len() <= self.count
            && (soup.sh_degree == self.sh_degree || soup.is_empty());
        if self.corners_left > 0 || !fits {
            return Err(wrong_count());
        }
        let k = soup.sh_count();
        let first = self.written;
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
    /// # Errors
    ///
    /// As for [`write_soup`]; fewer triangles than were announced.
    pub fn end(self, cameras: &[Camera]) -> io::Result<()> {
        if self.written < self.count {
            return Err(wrong_count());
        }
        write_views(self.out, cameras)
    }
}

fn wrong_count() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "other triangles than were announced")
}

fn header(
    count: usize,
    sh_degree: u8,
    provenance: &Provenance,
    cameras: &[Camera],
    shell: bool,
) -> String {
    let mut header =
        String::from("ply\nformat binary_little_endian 1.0\ncomment trisplat soup 1\n");
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
    header + &view_header(cameras) + "end_header\n"
}

// ---- The element `view` of a soup PLY: the cameras of its photos --------------------------------

const VIEW: &str = "view";
/// R by rows, t, focal lengths and principal point.
const FLOATS: [&str; 16] = [
    "r00", "r01", "r02", "r10", "r11", "r12", "r20", "r21", "r22", "tx", "ty", "tz", "fx", "fy",
    "cx", "cy",
];
/// The size of the picture, px.
const INTEGERS: [&str; 2] = ["width", "height"];

/// The name of the element, empty unless it exists with all properties of a camera.
pub(super) fn view_name(header: &PlyHeader) -> &'static str {
    let element = header.element(VIEW).filter(|e| FLOATS.iter().chain(&INTEGERS).all(|p| e.has(p)));
    element.map_or("", |_| VIEW)
}

/// The element's lines in the header; empty without cameras.
fn view_header(cameras: &[Camera]) -> String {
    if cameras.is_empty() {
        return String::new();
    }
    let mut header = format!("element {VIEW} {}\n", cameras.len());
    for name in FLOATS {
        header += &format!("property float {name}\n");
    }
    for name in INTEGERS {
        header += &format!("property uint {name}\n");
    }
    header
}

/// Writes the rows.
fn write_views(out: &mut dyn Write, cameras: &[Camera]) -> io::Result<()> {
    write_blocks(out, cameras.len(), |i, block| {
        let Camera { rotation, translation, focal, center, size } = cameras[i];
        let rows = rotation.transpose().to_cols_array();
        let rest =
            translation.to_array().into_iter().chain(focal.to_array()).chain(center.to_array());
        for number in rows.into_iter().chain(rest) {
            block.extend_from_slice(&number.to_le_bytes());
        }
        for side in size.to_array() {
            block.extend_from_slice(&side.to_le_bytes());
        }
    })
}

/// The cameras. An error names the first row that is invalid, or whose pictures are too large.
pub(super) fn read_views(table: &PlyTable, limits: &Limits) -> Result<Vec<Camera>> {
    let floats = table.columns(FLOATS)?;
    let integers = table.columns(INTEGERS)?;
    let mut cameras = Vec::new();
    table.each_row(|i, row| {
        let [rotation @ .., tx, ty, tz, fx, fy, cx, cy] =
            floats.map(|column: Column| column.f32(row));
        let camera = Camera {
            rotation: Mat3::from_cols_array(&rotation).transpose(),
            translation: Vec3::new(tx, ty, tz),
            focal: Vec2::new(fx, fy),
            center: Vec2::new(cx, cy),
            size: UVec2::from(integers.map(|column| u32::try_from(column.int(row)).unwrap_or(0))),
        };
        limits.camera(format!("{}: {VIEW} {i}", table.path.display()), camera.size)?;
        let turns = (camera.rotation.determinant() - 1.0).abs() < 0.01;
        if camera.validate(limits).is_err() || !turns {
            return Err(table.error(i, crate::splats::cameras::NO_CAMERA));
        }
        cameras.push(camera);
        Ok(())
    })?;
    Ok(cameras)
}
