//! COFF of the authors' exporter, and OFF with face or vertex colours (read only).
//!
//! ```text
//! COFF
//! 225171 75057 0
//! -0.475 -4.081 -0.177            x y z, or x y z r g b [a]
//! 3 0 1 2 62 51 51 255            number of corners, corners, and perhaps r g b [a]
//! ```
//!
//! The format has no σ and its exporter drops opacity, so triangles are read as solid; an alpha
//! below 1 at a face becomes opacity.

use crate::faces::{ClampCounter, FaceList, check_corners};
use crate::finish::{FarPositions, finish};
use crate::lines::{LineReader, number};
use crate::{ReadOptions, Source};
use glam::DVec3;
use std::path::{Path, PathBuf};
use trisplat_scene::math::color::linear_from_srgb;
use trisplat_scene::mesh::{Colors, Mesh};
use trisplat_scene::{
    Error, ImportedScene, Limits, Provenance, Result, Scene, UpAxis, excerpt, input,
};

/// Minimum bytes of the line of a vertex: `0 0 0`.
const MIN_VERTEX_BYTES: u64 = 6;
/// Minimum bytes of the line of a face: `3 0 1 2`.
const MIN_FACE_BYTES: u64 = 8;

/// The mesh in an OFF or COFF file, with the file's indices, linear colours, and polygons cut into
/// triangles.
///
/// # Errors
///
/// `Malformed` with the line for broken text, bad corner numbers and faces of fewer than three
/// corners; `Unsupported` for binary OFF and the variants with normals, texture or four dimensions.
pub fn read(source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    let mut lines = LineReader::new(&source)?;
    let limits = &options.limits;
    let (vertices, faces) = read_counts(&source, &mut lines, limits)?;
    let mut mesh = Mesh::default();
    let mut of_vertices = FileColors::default();
    let mut of_faces = FileColors::default();
    let mut positions = FarPositions::default();
    positions.reserve(limits, source.path.display(), vertices)?;
    for vertex in 0..vertices {
        advance(&mut lines, || format!("vertex {vertex} of {vertices}"))?;
        positions.push(position(&lines, &mut of_vertices).map_err(|reason| lines.error(reason))?);
    }
    let mut indices = Vec::new();
    let mut corners = Vec::new();
    limits.reserve(source.path.display(), &mut indices, 3 * faces)?;
    let mut face_list = FaceList::from_triangles(indices);
    for face in 0..faces {
        advance(&mut lines, || format!("face {face} of {faces}"))?;
        read_corners(&lines, vertices, &mut corners, &mut of_faces)
            .and_then(|()| face_list.push(&corners))
            .map_err(|reason| lines.error(format!("face {face} {reason}")))?;
        limits.triangles(source.path.display(), face_list.triangles() as u64)?;
    }
    let origin;
    (mesh.positions, origin) = positions.relative();
    let triangles = face_list.triangulate(&mesh.positions);
    let mut warnings = Vec::new();
    if of_vertices.any && of_faces.any {
        warnings
            .push("vertices and faces both have colours: those of the vertices are used".into());
    }
    warnings.extend(softness_beside(&source.path));
    if !of_vertices.any && !of_faces.any {
        warnings.push("the file has no colours: every triangle is white".into());
    }
    if of_vertices.any {
        mesh.colors = Colors::Vertex(of_vertices.linear(&source, &mut warnings)?.0);
    } else {
        let (colors, alpha) = of_faces.linear(&source, &mut warnings)?;
        mesh.colors = Colors::Face(triangles.repeat(colors));
        mesh.opacity = if alpha.is_empty() { alpha } else { triangles.repeat(alpha) };
    }
    // Vertices of triangles of their own are those of a soup, which the authors' script wrote.
    let is_soup = triangles.indices.iter().copied().eq(0..mesh.positions.len() as u32);
    mesh.indices = triangles.indices;
    let usual_up = (!is_soup).then_some(UpAxis::Y);
    let provenance = Provenance { usual_up, ..Provenance::default() };
    let loaded =
        ImportedScene { scene: Scene::Mesh(mesh), provenance, warnings, cameras: Vec::new() };
    finish(&source.path, loaded, origin)
}

/// Names a checkpoint in the folder of an OFF file: the authors' scripts make OFF files of such,
/// without softness.
fn softness_beside(path: &Path) -> Option<String> {
    let folder = path.parent().filter(|_| path.as_os_str() != "-")?;
    let is_checkpoint =
        |file: &PathBuf| file.extension().is_some_and(|e| e == "pt") && file.is_file();
    let checkpoints = input::entries(folder).filter(is_checkpoint);
    // A checkpoint of the same name first.
    let checkpoint =
        checkpoints.min_by_key(|file| (file.file_stem() != path.file_stem(), file.clone()))?;
    let name = checkpoint.file_name()?.to_string_lossy().into_owned();
    Some(format!(
        "an OFF file holds no softness: if {name} beside it is of the same training, give that, and the scene looks as it was trained"
    ))
}

/// Parses the head of the file: the numbers of vertices and of faces, checked against its length.
fn read_counts(source: &Source, lines: &mut LineReader, limits: &Limits) -> Result<(usize, usize)> {
    if !lines.advance_to_text()? {
        return Err(Error::malformed(&source.path, "line 1", "the file is empty"));
    }
    let mut words: Vec<String> = lines.words().map(str::to_owned).collect();
    let keyword = words.remove(0);
    if keyword != "OFF" && keyword != "COFF" {
        return Err(if keyword.ends_with("OFF") {
            Error::unsupported(
                &source.path,
                format!("is {}; save it as OFF or COFF", excerpt(&keyword)),
            )
        } else {
            lines.error("is not an OFF file: it must start with OFF or COFF")
        });
    }
    if words.first().is_some_and(|word| word == "BINARY") {
        return Err(Error::unsupported(&source.path, "is binary OFF; save it as text"));
    }
    if words.is_empty() {
        advance(lines, || "the counts of vertices and faces".into())?;
        words = lines.words().map(str::to_owned).collect();
    }
    let count = |at: usize| words.get(at).and_then(|word| word.parse::<u64>().ok());
    let wrong_counts = "expected the counts of vertices and faces, two whole numbers";
    let vertices = count(0).ok_or_else(|| lines.error(wrong_counts))?;
    let faces = count(1).ok_or_else(|| lines.error(wrong_counts))?;
    if faces == 0 {
        return Err(lines.error("promises 0 faces: there are no triangles in the file"));
    }
    let min_bytes = vertices
        .saturating_mul(MIN_VERTEX_BYTES)
        .saturating_add(faces.saturating_mul(MIN_FACE_BYTES));
    if min_bytes > source.len + 1 {
        let len = source.len;
        return Err(lines.error(format!(
            "promises {vertices} vertices and {faces} faces, more than fit in the {len} bytes of the file"
        )));
    }
    limits.triangles(source.path.display(), faces)?;
    limits.vertices(source.path.display(), vertices)?;
    match (usize::try_from(vertices), usize::try_from(faces)) {
        (Ok(v), Ok(f)) if u32::try_from(vertices).is_ok() => Ok((v, f)),
        _ => Err(Error::unsupported(
            &source.path,
            "has more vertices than 32-bit numbers reach: split it",
        )),
    }
}

fn advance(lines: &mut LineReader, what: impl Fn() -> String) -> Result<()> {
    if lines.advance_to_text()? {
        return Ok(());
    }
    Err(lines.error(format!("the file ends before {}: it was cut short", what())))
}

fn position(lines: &LineReader, colors: &mut FileColors) -> Result<DVec3, String> {
    let mut words = lines.words();
    let mut axis = || number(words.next().ok_or("expected x y z")?);
    let position = DVec3::new(axis()?, axis()?, axis()?);
    colors.push(words)?;
    Ok(position)
}

/// Reads a face's corners, and its colour into `colors`.
fn read_corners(
    lines: &LineReader,
    vertices: usize,
    corners: &mut Vec<u32>,
    colors: &mut FileColors,
) -> Result<(), String> {
    let mut words = lines.words();
    let count = words.next().unwrap_or_default();
    let count = count.parse::<i64>().map_err(|_| {
        format!("starts with {:?}; expected the number of its corners", excerpt(count))
    })?;
    let count = check_corners(count)?;
    corners.clear();
    for _ in 0..count {
        let word = words.next().ok_or_else(|| format!("has fewer than {count} corners"))?;
        let index = word.parse::<u32>().ok().filter(|v| (*v as usize) < vertices);
        corners.push(index.ok_or_else(|| {
            format!("names vertex {:?}, but there are {vertices} vertices", excerpt(word))
        })?);
    }
    colors.push(words)
}

/// Colours of the file. Their scale, 0 to 255 or 0 to 1, is known only at the end: `1 1 0` is
/// yellow in a file of floats and nearly black in one of integers.
#[derive(Default)]
struct FileColors {
    rows: Vec<Option<FileColor>>,
    any: bool,
    floats: bool,
}

struct FileColor {
    rgb: [f32; 3],
    alpha: Option<f32>,
}

impl FileColors {
    fn push<'w>(&mut self, words: impl Iterator<Item = &'w str>) -> Result<(), String> {
        let mut row = [0.0; 4];
        let mut count = 0;
        for word in words {
            let slot = row.get_mut(count).ok_or("has more numbers than r g b a")?;
            *slot = number(word)?;
            self.floats |= word.parse::<i64>().is_err();
            count += 1;
        }
        let [r, g, b, a] = row;
        match count {
            0 => self.rows.push(None),
            3 | 4 => {
                self.rows.push(Some(FileColor { rgb: [r, g, b], alpha: (count == 4).then_some(a) }))
            }
            _ => {
                return Err(format!(
                    "has {count} numbers for its colour; expected r g b or r g b a"
                ));
            }
        }
        self.any |= count > 0;
        Ok(())
    }

    /// Linear colours, white where there was none, and alpha if any value is below 1.
    fn linear(
        &self,
        source: &Source,
        warnings: &mut Vec<String>,
    ) -> Result<(Vec<[f32; 3]>, Vec<f32>)> {
        let mut clamped = ClampCounter::default();
        let mut unit =
            |value: f32| if self.floats { clamped.channel(value) } else { value / 255.0 };
        let mut colors = Vec::new();
        let mut alphas = Vec::new();
        colors.reserve_exact(self.rows.len());
        for (at, row) in self.rows.iter().enumerate() {
            let Some(FileColor { rgb, alpha }) = row else {
                colors.push([1.0; 3]);
                continue;
            };
            if let Some(bad) =
                rgb.iter().chain(alpha).find(|x| !self.floats && !(0.0..=255.0).contains(*x))
            {
                let reason = format!("integer colours must lie in 0 to 255; row {at} has {bad}");
                return Err(Error::malformed(&source.path, "colours", reason));
            }
            colors.push(rgb.map(|x| linear_from_srgb(unit(x))));
            if let Some(alpha) = alpha.map(&mut unit).filter(|alpha| *alpha != 1.0) {
                alphas.resize(self.rows.len(), 1.0);
                alphas[at] = alpha;
            }
        }
        clamped.report(&source.path, warnings)?;
        Ok((colors, alphas))
    }
}
