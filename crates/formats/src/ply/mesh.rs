//! Triangle mesh PLY with vertex or face colours, read and written.

use super::header::{Column, Scalar};
use super::table::{self, PlyTable};
use crate::ReadOptions;
use crate::faces::{ClampCounter, Triangles, mean};
use crate::lines::{to_comment, write_blocks};
use crate::mtl::{OVER_COLORS, has_colors, picture};
use glam::{DVec3, Vec2, Vec3};
use std::collections::BTreeMap;
use std::io::{self, Write};
use std::slice::ChunksExact;
use std::sync::Arc;
use trisplat_scene::atlas::{PaintedFaces, paint};
use trisplat_scene::math::color::{linear_from_srgb, linear_of_srgb8, srgb8_from_linear};
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Asset, Error, Result, Texture};

/// The mesh, relative to `origin`, with the pictures that `comments` name; guesses and repairs are
/// added to `warnings`.
pub(super) fn read(
    vertices: &PlyTable,
    faces: &PlyTable,
    origin: DVec3,
    comments: &[String],
    options: &ReadOptions,
    warnings: &mut Vec<String>,
) -> Result<Mesh> {
    let limits = &options.limits;
    let of_vertices = Channels::of(vertices)?;
    let of_faces = Channels::of(faces)?;
    let polygons = faces.faces(vertices.rows, limits)?;
    let mut positions = limits.zeroed::<Vec3>(vertices.path.display(), vertices.rows)?;
    vertices.read_positions(origin, &mut positions)?;
    let triangles = polygons.triangulate(&positions);
    let painted = pictures(vertices, faces, &triangles, comments, options, warnings)?;
    let mut mesh = Mesh { positions, ..Mesh::default() };
    match (of_vertices, of_faces) {
        (Some(of_vertices), of_faces) => {
            if of_faces.is_some() {
                warnings.push(
                    "vertices and faces both have colours: those of the vertices are used".into(),
                );
            }
            let (colors, alpha) = of_vertices.read(vertices, warnings)?;
            mesh.colors = Colors::Vertex(colors);
            mesh.indices = triangles.into_indices(mesh.positions.len());
            if !alpha.is_empty() {
                let of_face = |face| largest(mesh.face(face).map(|v| alpha[v as usize]));
                mesh.opacity = parallel::collect(mesh.face_count(), GRAIN, of_face);
            }
        }
        (None, Some(of_faces)) => {
            let (colors, alpha) = of_faces.read(faces, warnings)?;
            mesh.colors = Colors::Face(triangles.repeat(colors));
            mesh.opacity = if alpha.is_empty() { alpha } else { triangles.repeat(alpha) };
            mesh.indices = triangles.into_indices(mesh.positions.len());
        }
        (None, None) => {
            mesh.indices = triangles.into_indices(mesh.positions.len());
            mesh.colors = Colors::Face(vec![[1.0; 3]; mesh.face_count()]);
            if painted.is_none() {
                warnings.push("the file has no colours: every triangle is white".into());
            }
        }
    }
    if let Some((parts, textures)) = painted {
        warnings.extend(has_colors(&mesh).then(|| OVER_COLORS.to_owned()));
        mesh.colors = Colors::Face(vec![[1.0; 3]; mesh.face_count()]);
        warnings.extend(paint(&mut mesh, parts, &textures));
    }
    Ok(mesh)
}

/// The largest of three values; NaN when one is NaN. Scanners leave corners without alpha on opaque
/// faces.
fn largest(alpha: [f32; 3]) -> f32 {
    if alpha.iter().any(|a| a.is_nan()) { f32::NAN } else { alpha[0].max(alpha[1]).max(alpha[2]) }
}

type Textures = BTreeMap<usize, Option<Arc<Texture>>>;

/// The faces on the pictures of `comment TextureFile`, and the pictures that could be read; `None`
/// without any.
fn pictures(
    vertices: &PlyTable,
    faces: &PlyTable,
    triangles: &Triangles,
    comments: &[String],
    options: &ReadOptions,
    warnings: &mut Vec<String>,
) -> Result<Option<(Vec<PaintedFaces>, Textures)>> {
    let named = |comment: &String| {
        let (key, name) = comment.split_once(char::is_whitespace)?;
        key.eq_ignore_ascii_case("TextureFile").then(|| name.trim().to_owned())
    };
    let names: Vec<String> = comments.iter().filter_map(named).collect();
    if names.is_empty() {
        return Ok(None);
    }
    let face_of = triangles.repeat((0..faces.rows as u32).collect());
    let corners = triangles.indices.as_chunks::<3>().0;
    let mut uvs = faces.corner_uvs(vertices.rows, &options.limits)?.of(corners, &face_of);
    let columns =
        [["s", "t"], ["u", "v"], ["texture_u", "texture_v"], ["texcoord_u", "texcoord_v"]];
    let columns = columns.into_iter().find_map(|[u, v]| vertices.find(u).zip(vertices.find(v)));
    if uvs.is_empty()
        && let Some((u, v)) = columns
    {
        let mut places = Vec::with_capacity(vertices.rows);
        vertices.each_row(|_, row| {
            places.push(Vec2::new(u.f32(row), 1.0 - v.f32(row)));
            Ok(())
        })?;
        uvs = corners.iter().map(|corners| corners.map(|vertex| places[vertex as usize])).collect();
    }
    if uvs.is_empty() {
        let lost = format!(
            "{} is not read: the file has no texture coordinates (s t, u v or texcoord)",
            names.join(", ")
        );
        warnings.push(lost);
        return Ok(None);
    }
    let mut numbers = Vec::new();
    if let Some(number) = faces.find("texnumber").filter(|_| names.len() > 1) {
        faces.each_row(|_, row| {
            numbers.push(number.int(row));
            Ok(())
        })?;
    }
    let parts = parts_by_picture(&numbers, &face_of, &uvs);
    let read = |(number, name): (usize, &String)| {
        let read = picture(vertices.path, name, options);
        let unread = |e| warnings.push(format!("a texture is not read: {e}"));
        (number, read.map_err(unread).ok())
    };
    let textures: Textures = names.iter().enumerate().map(read).collect();
    Ok(textures.values().any(Option::is_some).then_some((parts, textures)))
}

/// The triangles in runs with one picture. `numbers` are the pictures of the file's faces, or empty
/// for a single one; `face_of` is the face of each triangle.
fn parts_by_picture(numbers: &[i64], face_of: &[u32], uvs: &[[Vec2; 3]]) -> Vec<PaintedFaces> {
    let image = |face: &u32| {
        numbers.get(*face as usize).map_or(0, |number| usize::try_from(*number).unwrap_or(0))
    };
    let mut parts = Vec::new();
    let mut end = 0;
    for run in face_of.chunk_by(|a, b| image(a) == image(b)) {
        let faces = end..end + run.len();
        end = faces.end;
        parts.push(PaintedFaces {
            image: image(&run[0]),
            uvs: uvs[faces.clone()].to_vec(),
            faces,
            wrap: Default::default(),
            filter: Default::default(),
        });
    }
    parts
}

/// The places of red, green, blue and perhaps alpha in a row.
struct Channels {
    rgb: [Column; 3],
    alpha: Option<Column>,
}

impl Channels {
    fn of(table: &PlyTable) -> Result<Option<Self>> {
        let named = |names: [&str; 4]| {
            let [r, g, b, a] = names.map(|name| table.find(name));
            Some(Self { rgb: [r?, g?, b?], alpha: a })
        };
        let channels = named(["red", "green", "blue", "alpha"])
            .or_else(|| named(["r", "g", "b", "a"]))
            .or_else(|| named(["diffuse_red", "diffuse_green", "diffuse_blue", "diffuse_alpha"]));
        let Some(channels) = channels else { return Ok(None) };
        let known =
            |c: &Column| matches!(c.scalar, Scalar::U8 | Scalar::U16 | Scalar::F32 | Scalar::F64);
        if channels.rgb.iter().chain(&channels.alpha).all(known) {
            return Ok(Some(channels));
        }
        let reason = "has colours of a signed or 32-bit integer type; \
                      write them as uchar (0 to 255), ushort (0 to 65535) or float (0 to 1)";
        Err(Error::unsupported(table.path, reason))
    }

    /// Linear colours, and alpha if any value is below 1. `[rows]`, `[rows]` or `[]`
    fn read(
        &self,
        table: &PlyTable,
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<[f32; 3]>, Vec<f32>)> {
        let mut colors = vec![[0.0; 3]; table.rows];
        let mut alpha = vec![0.0; table.rows];
        let step = table.rows_per_block();
        let parts = colors.chunks_mut(step).zip(alpha.chunks_mut(step));
        let blocks =
            table.blocks(parts, |_, rows, (colors, alpha)| Ok(self.decode(rows, colors, alpha)))?;
        let mut clamped = ClampCounter::default();
        for block in blocks {
            clamped.merge(block);
        }
        clamped.report(table.path, warnings)?;
        if alpha.iter().all(|a| *a == 0.0) && table.rows > 0 && self.alpha.is_some() {
            warnings.push("alpha is 0 everywhere, which is no opacity: it is not read".to_owned());
            alpha.clear();
        } else if alpha.iter().all(|a| *a == 1.0) {
            alpha.clear();
        }
        Ok((colors, alpha))
    }

    fn decode(
        &self,
        rows: ChunksExact<u8>,
        colors: &mut [[f32; 3]],
        alpha: &mut [f32],
    ) -> ClampCounter {
        let codes = linear_of_srgb8();
        let mut clamped = ClampCounter::default();
        for ((row, color), alpha) in rows.zip(colors).zip(alpha) {
            *color = self.rgb.map(|column| match column.scalar {
                Scalar::U8 => codes[row[column.offset] as usize],
                _ => linear_from_srgb(channel(column, row, &mut clamped)),
            });
            *alpha = self.alpha.map_or(1.0, |column| channel(column, row, &mut clamped));
        }
        clamped
    }
}

/// A channel of the file in [0, 1], still encoded; NaN when it is not finite.
fn channel(column: Column, row: &[u8], clamped: &mut ClampCounter) -> f32 {
    match column.scalar {
        Scalar::U8 => column.f32(row) / 255.0,
        Scalar::U16 => column.f32(row) / 65535.0,
        _ => clamped.channel(column.f32(row)),
    }
}

/// Writes a mesh PLY: binary little-endian, sRGB colours and alpha in 8 bits.
///
/// By default the colours are at the vertices, which every reader understands; with colour or
/// opacity per face, each triangle gets three vertices of its own. With `face_colors` they are at
/// the faces, vertices stay shared, and a face with different corner colours gets their linear
/// mean. The faces of a backdrop are the last; `backdrop` in the comment counts them.
///
/// # Errors
///
/// Errors of `out`, and `InvalidInput` above 2,147,483,647 vertices.
pub fn write_mesh(out: &mut dyn Write, asset: &Asset, face_colors: bool) -> io::Result<()> {
    let mesh = &asset.mesh;
    let unshared = mesh.indices.is_empty()
        || !face_colors && (matches!(mesh.colors, Colors::Face(_)) || !mesh.opacity.is_empty());
    let vertices = if unshared { 3 * mesh.face_count() } else { mesh.vertex_count() };
    if vertices > i32::MAX as usize {
        return Err(io::Error::new(
            io::ErrorKind::InvalidInput,
            "too many vertices for a PLY file",
        ));
    }
    let mut header = String::from("ply\nformat binary_little_endian 1.0\n");
    table::push_comment(&mut header, &to_comment(&asset.provenance));
    let channels =
        "property uchar red\nproperty uchar green\nproperty uchar blue\nproperty uchar alpha\n";
    header += &format!(
        "element vertex {vertices}\nproperty float x\nproperty float y\nproperty float z\n"
    );
    header += if mesh.normals.is_empty() { "" } else { NORMAL };
    header += if face_colors { "" } else { channels };
    header +=
        &format!("element face {}\nproperty list uchar int vertex_indices\n", mesh.face_count());
    header += if face_colors { channels } else { "" };
    header += "end_header\n";
    out.write_all(header.as_bytes())?;
    write_vertices(out, mesh, unshared, face_colors)?;
    write_blocks(out, mesh.face_count(), |face, block| {
        let corners =
            if unshared { [0, 1, 2].map(|i| 3 * face as u32 + i) } else { mesh.face(face) };
        table::push_corners(block, corners);
        if face_colors {
            block.extend_from_slice(&rgba(mean(mesh.corner_colors(face)), opacity(mesh, face)));
        }
    })
}

const NORMAL: &str = "property float nx\nproperty float ny\nproperty float nz\n";

fn write_vertices(
    out: &mut dyn Write,
    mesh: &Mesh,
    unshared: bool,
    face_colors: bool,
) -> io::Result<()> {
    if unshared {
        return write_blocks(out, mesh.face_count(), |face, block| {
            let colors = mesh.corner_colors(face);
            let opacity = opacity(mesh, face);
            for (corner, color) in mesh.corners(face).into_iter().zip(colors) {
                push_vector(block, corner);
                if let Some(normal) = mesh.normals.get(face) {
                    push_vector(block, *normal);
                }
                if !face_colors {
                    block.extend_from_slice(&rgba(color, opacity));
                }
            }
        });
    }
    let normals = mesh.vertex_normals();
    write_blocks(out, mesh.vertex_count(), |v, block| {
        push_vector(block, mesh.positions[v]);
        if let Some(normal) = normals.get(v) {
            push_vector(block, *normal);
        }
        if let Colors::Vertex(colors) = &mesh.colors
            && !face_colors
        {
            block.extend_from_slice(&rgba(colors[v], 1.0));
        }
    })
}

fn push_vector(block: &mut Vec<u8>, vector: Vec3) {
    for axis in vector.to_array() {
        block.extend_from_slice(&axis.to_le_bytes());
    }
}

fn opacity(mesh: &Mesh, face: usize) -> f32 {
    mesh.opacity.get(face).copied().unwrap_or(1.0)
}

fn rgba(linear: [f32; 3], opacity: f32) -> [u8; 4] {
    let [r, g, b] = linear.map(srgb8_from_linear);
    [r, g, b, (255.0 * opacity).round() as u8]
}
