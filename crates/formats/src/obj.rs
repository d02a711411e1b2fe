//! Wavefront OBJ with vertex colours, `v x y z r g b`, sRGB-encoded as usual, or with the picture
//! of a material: read and written.
//!
//! The crate `tobj` is not used: it shifts colours when only some vertices have one, cuts every
//! polygon as if it were convex, and does not name the faulty line. Our tests compare with it, and
//! one of them fails when its colours are fixed.

use crate::faces::{ClampCounter, CornerUvs, FaceList};
use crate::finish::{FarPositions, finish};
use crate::lines::{self, LineReader, as_utf8, number, push_float, push_integer, write_blocks};
use crate::mtl::Materials;
use crate::{ReadOptions, Source};
use glam::{DVec3, Vec2, Vec3};
use std::io::{self, Write};
use std::sync::LazyLock;
use trisplat_scene::math::color::{
    linear_from_srgb, linear_of_srgb8, srgb_from_linear, srgb8_from_linear,
};
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{Asset, Error, FaceTexture, ImportedScene, Result, Scene, UpAxis, excerpt};

pub use crate::mtl::named_files;

/// The mesh in an OBJ file: all objects and groups as one, vertex colours made linear, white where
/// a vertex has none, polygons as triangles. Without vertex colours it has the colours of its
/// materials, or their picture if one paints the whole mesh. Normals, lines and points are skipped.
///
/// # Errors
///
/// `Malformed` with the line for broken numbers, corners without a vertex, and faces of fewer than
/// three corners.
pub fn read(source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    let source = as_utf8(&source, &options.limits)?;
    let path = &source.path;
    let mut lines = LineReader::new(&source)?;
    let mut draft = ObjDraft::default();
    while lines.advance()? {
        draft.take_line(&lines).map_err(|reason| lines.error(reason))?;
        options.limits.triangles(path.display(), draft.faces.triangles() as u64)?;
        options.limits.vertices(
            path.display(),
            draft.positions.len().max(draft.corner_uvs.uvs.len()) as u64,
        )?;
    }
    if draft.faces.len() == 0 {
        return Err(Error::malformed(
            path,
            "the file",
            "has no faces: there are no triangles in it",
        ));
    }
    if let Some((line, vertex)) =
        draft.ahead.filter(|(_, vertex)| *vertex > draft.positions.len() as i64)
    {
        let reason =
            format!("names vertex {vertex}, but there are {} vertices", draft.positions.len());
        return Err(Error::malformed(path, format!("line {line}"), reason));
    }
    let mut warnings = Vec::new();
    let comments = draft.comments.iter().map(String::as_str);
    let mut provenance = lines::from_comments(comments.clone(), &mut warnings);
    provenance.up = provenance.up.or_else(|| lines::up_of_program(comments, &PROGRAMS));
    provenance.usual_up = provenance.up.is_none().then_some(UpAxis::Y);
    let (mesh, origin) = draft.mesh(path, options, &mut warnings)?;
    let loaded =
        ImportedScene { scene: Scene::Mesh(mesh), provenance, warnings, cameras: Vec::new() };
    finish(path, loaded, origin)
}

/// Programs that turn their scenes y up for this format.
const PROGRAMS: [(&str, UpAxis); 5] = [
    ("blender", UpAxis::Y),
    ("3ds max", UpAxis::Y),
    ("maya", UpAxis::Y),
    ("cinema 4d", UpAxis::Y),
    ("zbrush", UpAxis::Y),
];

/// A mesh during reading.
#[derive(Default)]
struct ObjDraft {
    positions: FarPositions,
    /// sRGB-encoded. Empty until the first vertex that has a colour.
    colors: Vec<[f32; 3]>,
    uncolored: usize,
    faces: FaceList,
    /// The corners of the face being read.
    corners: Vec<u32>,
    /// The largest vertex number (from 1) used before its vertex was read, and its line.
    ahead: Option<(u64, i64)>,
    comments: Vec<String>,
    corner_uvs: CornerUvs,
    materials: Materials,
}

/// The number for a corner without texture coordinates.
const NOWHERE: u32 = u32::MAX;

impl ObjDraft {
    fn take_line(&mut self, lines: &LineReader) -> Result<(), String> {
        let mut words = lines.words();
        match words.next() {
            Some("v") => self.take_vertex(words),
            Some("f") => self.take_face(words, lines.number),
            Some("vt") => self.take_place(words),
            Some("mtllib") => {
                self.materials.library(lines.rest());
                Ok(())
            }
            Some("usemtl") => {
                self.materials.begin(lines.rest(), self.faces.len());
                Ok(())
            }
            None => {
                self.comments.extend(lines.text().strip_prefix('#').map(str::to_owned));
                Ok(())
            }
            Some(_) => Ok(()),
        }
    }

    /// `x y z`, then nothing, a weight (which only curves use), a colour, or a colour and its
    /// alpha.
    fn take_vertex<'w>(&mut self, words: impl Iterator<Item = &'w str>) -> Result<(), String> {
        let mut row = [0.0f64; 7];
        let mut count = 0;
        for word in words {
            *row.get_mut(count).ok_or("has more numbers than x y z r g b a")? = number(word)?;
            count += 1;
        }
        let [x, y, z, r, g, b, _] = row;
        match count {
            3 | 4 => self.uncolored += 1,
            6 | 7 if self.colors.is_empty() => self.colors.resize(self.positions.len(), [1.0; 3]),
            6 | 7 => {}
            _ => return Err(format!("has {count} numbers; expected x y z or x y z r g b")),
        }
        self.positions.push(DVec3::new(x, y, z));
        if count >= 6 {
            self.colors.push([r, g, b].map(|channel| channel as f32));
        } else if !self.colors.is_empty() {
            self.colors.push([1.0; 3]);
        }
        Ok(())
    }

    /// `u`, `u v` or `u v w`.
    fn take_place<'w>(&mut self, mut words: impl Iterator<Item = &'w str>) -> Result<(), String> {
        let mut next = || words.next().map_or(Ok(0.0), number::<f32>);
        self.corner_uvs.uvs.push(Vec2::new(next()?, next()?));
        Ok(())
    }

    fn take_face<'w>(
        &mut self,
        words: impl Iterator<Item = &'w str>,
        line: u64,
    ) -> Result<(), String> {
        let in_face = |face: usize, reason: String| format!("face {face} {reason}");
        self.corners.clear();
        for word in words {
            let corner =
                self.corner(word, line).map_err(|reason| in_face(self.faces.len(), reason))?;
            self.corners.push(corner);
            if let Some(place) = self.place(word) {
                self.corner_uvs.push(self.faces.len(), corner, place);
            }
        }
        self.faces.push(&self.corners).map_err(|reason| in_face(self.faces.len(), reason))?;
        self.materials.add_face();
        self.corner_uvs.end_face();
        Ok(())
    }

    /// Number of the texture coordinates, from 0, of `5/1`, `5/1/1` or `5/-1`.
    fn place(&self, corner: &str) -> Option<u32> {
        let place =
            corner.split('/').nth(1).filter(|text| !text.is_empty())?.parse::<i64>().ok()?;
        let from_one = if place < 0 { self.corner_uvs.uvs.len() as i64 + 1 + place } else { place };
        Some(u32::try_from(from_one - 1).unwrap_or(NOWHERE))
    }

    /// Vertex number from 0 of `5`, `5/1`, `5//1`, `5/1/1`, or `-1` for the latest vertex.
    fn corner(&mut self, word: &str, line: u64) -> Result<u32, String> {
        let vertex = word.split('/').next().unwrap_or_default().parse::<i64>();
        let vertex = vertex
            .map_err(|_| format!("has the corner {:?}; expected a vertex number", excerpt(word)))?;
        let read = self.positions.len() as i64;
        let from_one = if vertex < 0 { read + 1 + vertex } else { vertex };
        if from_one > read && self.ahead.is_none_or(|(_, largest)| from_one > largest) {
            self.ahead = Some((line, from_one));
        }
        match u32::try_from(from_one - 1) {
            Ok(index) => Ok(index),
            Err(_) => {
                Err(format!("names vertex {vertex}, but there are {read} vertices before it"))
            }
        }
    }

    /// The mesh, and the origin subtracted from its positions.
    fn mesh(
        mut self,
        path: &std::path::Path,
        options: &ReadOptions,
        warnings: &mut Vec<String>,
    ) -> Result<(Mesh, DVec3)> {
        let (positions, origin) = std::mem::take(&mut self.positions).relative();
        let faces = std::mem::take(&mut self.faces);
        let count = faces.len();
        let triangles = faces.triangulate(&positions);
        let mut mesh = Mesh { positions, ..Mesh::default() };
        // Beside colours of vertices only pictures count.
        let painted = !self.materials.of_face.is_empty()
            && (self.colors.is_empty() || !self.corner_uvs.uvs.is_empty());
        let mut places = Vec::new();
        if painted {
            let face_of = triangles.repeat((0..count as u32).collect());
            places = self.corner_uvs.of(triangles.indices.as_chunks::<3>().0, &face_of);
            self.materials.of_face = triangles.repeat(std::mem::take(&mut self.materials.of_face));
        }
        mesh.indices = triangles.into_indices(mesh.positions.len());
        let is_colored = !self.colors.is_empty();
        if is_colored {
            if self.uncolored > 0 {
                let vertices = match self.uncolored {
                    1 => "1 vertex without a colour is".to_owned(),
                    count => format!("{count} vertices without a colour are"),
                };
                warnings.push(format!("{vertices} white"));
            }
            let mut clamped = ClampCounter::default();
            let mut colors = self.colors;
            for color in &mut colors {
                *color = color.map(|x| linear_from_srgb(clamped.channel(x)));
            }
            clamped.report(path, warnings)?;
            mesh.colors = Colors::Vertex(colors);
        }
        let painted = painted && self.materials.apply(&mut mesh, &places, path, options, warnings);
        if !painted && !is_colored {
            warnings.push("the file has no colours: every triangle is white".into());
            mesh.colors = Colors::Face(vec![[1.0; 3]; mesh.face_count()]);
        }
        Ok((mesh, origin))
    }
}

/// Writes an OBJ to `out`, with sRGB vertex colours or with the texture whose picture is called
/// `picture`, and its material to `mtl`, which `out` names as `mtl_name`. Numbers are the shortest
/// that read back equal.
///
/// With colours per face, each triangle gets three vertices of its own. OBJ has no opacity at
/// vertices, so none is written. Normals, where the mesh has them, are one for each face. The faces
/// of a backdrop come last, in a group of that name.
///
/// # Errors
///
/// Errors of `out` and `mtl`.
pub fn write(
    out: &mut dyn Write,
    mtl: &mut dyn Write,
    mtl_name: &str,
    picture: Option<&str>,
    asset: &Asset,
) -> io::Result<()> {
    let mesh = &asset.mesh;
    let lit = !mesh.normals.is_empty();
    let joined = mesh.texture.as_ref().map(FaceTexture::joined);
    let texture = joined.as_ref().zip(picture);
    writeln!(mtl, "newmtl trisplat\nKd 1 1 1\nillum {}", u8::from(lit))?;
    if let Some((_, picture)) = texture {
        writeln!(mtl, "map_Kd -clamp on {picture}")?;
    }
    let comment = lines::to_comment(&asset.provenance);
    if !comment.is_empty() {
        writeln!(out, "# {comment}")?;
    }
    writeln!(out, "mtllib {mtl_name}")?;
    write_vertices(out, mesh, texture.is_some())?;
    let unshared =
        mesh.indices.is_empty() || texture.is_none() && matches!(mesh.colors, Colors::Face(_));
    // Per vertex if all faces agree, else per corner.
    let shared =
        texture.and_then(|(texture, _)| texture.of_vertices(&mesh.indices, mesh.vertex_count()));
    if let Some((texture, _)) = texture {
        let uvs = shared.as_deref().unwrap_or(texture.uvs.as_flattened());
        write_blocks(out, uvs.len(), |i, block| push_place(block, uvs[i]))?;
    }
    write_blocks(out, mesh.normals.len(), |face, block| {
        push_vector(block, b"vn", mesh.normals[face])
    })?;
    out.write_all(b"usemtl trisplat\n")?;
    let first_backdrop_face = asset.scene_faces();
    let grouped = first_backdrop_face < mesh.face_count();
    if grouped && first_backdrop_face > 0 {
        out.write_all(b"g scene\n")?;
    }
    write_blocks(out, mesh.face_count(), |face, block| {
        if grouped && face == first_backdrop_face {
            block.extend_from_slice(b"g backdrop\n");
        }
        let corners =
            if unshared { [0, 1, 2].map(|c| 3 * face as u32 + c) } else { mesh.face(face) };
        block.push(b'f');
        for (k, corner) in corners.into_iter().enumerate() {
            block.push(b' ');
            push_integer(block, u64::from(corner) + 1);
            if texture.is_some() {
                let place =
                    if shared.is_some() { u64::from(corner) } else { (3 * face + k) as u64 };
                block.push(b'/');
                push_integer(block, place + 1);
            }
            if lit {
                block.extend_from_slice(if texture.is_some() { b"/" } else { b"//" });
                push_integer(block, face as u64 + 1);
            }
        }
        block.push(b'\n');
    })
}

/// Writes the vertices: the mesh's, or three of each face where faces have colours of their own.
fn write_vertices(out: &mut dyn Write, mesh: &Mesh, is_textured: bool) -> io::Result<()> {
    // Colours would be multiplied with the texture.
    if is_textured {
        return write_blocks(out, mesh.vertex_count(), |v, block| {
            push_vector(block, b"v", mesh.positions[v])
        });
    }
    match &mesh.colors {
        Colors::Vertex(colors) => write_blocks(out, mesh.vertex_count(), |v, block| {
            push_vertex(block, mesh.positions[v], colors[v]);
        }),
        Colors::Face(colors) => write_blocks(out, mesh.face_count(), |face, block| {
            for corner in mesh.corners(face) {
                push_vertex(block, corner, colors[face]);
            }
        }),
    }
}

/// Texture coordinates of a corner, from the lower left.
fn push_place(block: &mut Vec<u8>, uv: Vec2) {
    block.extend_from_slice(b"vt ");
    push_float(block, uv.x);
    block.push(b' ');
    push_float(block, 1.0 - uv.y);
    block.push(b'\n');
}

/// A line of a keyword and three numbers.
fn push_vector(block: &mut Vec<u8>, keyword: &[u8], vector: Vec3) {
    push_numbers(block, keyword, vector);
    block.push(b'\n');
}

fn push_numbers(block: &mut Vec<u8>, keyword: &[u8], vector: Vec3) {
    block.extend_from_slice(keyword);
    for axis in vector.to_array() {
        block.push(b' ');
        push_float(block, axis);
    }
}

fn push_vertex(block: &mut Vec<u8>, position: Vec3, linear: [f32; 3]) {
    push_numbers(block, b"v", position);
    for channel in linear {
        block.push(b' ');
        push_srgb(block, channel);
    }
    block.push(b'\n');
}

/// An sRGB-encoded channel. A value from an 8-bit code is written as exactly that code, because
/// engines that truncate would otherwise show the code below it.
fn push_srgb(block: &mut Vec<u8>, linear: f32) {
    static CODES: LazyLock<Vec<Vec<u8>>> = LazyLock::new(|| {
        let text = |code: u8| {
            let mut text = Vec::new();
            push_float(&mut text, f32::from(code) / 255.0);
            text
        };
        (0..=255).map(text).collect()
    });
    let code = srgb8_from_linear(linear);
    let exact = linear_of_srgb8()[usize::from(code)];
    if (linear - exact).abs() <= 1e-6 * exact {
        block.extend_from_slice(&CODES[usize::from(code)]);
    } else {
        push_float(block, srgb_from_linear(linear));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_survive_readers_that_cut_instead_of_rounding() {
        for code in 0..=255u8 {
            let mut text = Vec::new();
            push_srgb(&mut text, linear_of_srgb8()[usize::from(code)]);
            let value: f32 = String::from_utf8_lossy(&text).parse().expect("a number");
            assert_eq!((value * 255.0) as u8, code);
        }
    }
}
