//! PLY: our soup PLY, and triangle meshes with vertex or face colours.

use crate::far::note_origin;
use crate::finish::finish;
use crate::read_options::ReadOptions;
use crate::source::Source;
use crate::splats::build;
use crate::{gaussians, provenance};
pub use column::Column;
use glam::DVec3;
use header::{Element, Header};
pub use mesh::write_mesh;
pub use soup::{SoupWriter, write_soup};
use std::path::Path;
use table::Table;
use transcode::Wanted;
use trisplat_scene::{Error, ImportedScene, ImportedSplats, Limits, Result, Scene};

mod column;
mod corners;
pub mod header;
mod mesh;
mod packed_splats;
mod soup;
mod splats;
mod table;
mod transcode;

/// The scene in a PLY file: a soup when its faces have a `sigma`, else a mesh with its sRGB colours made
/// linear, alpha (of a face, or the least of its corners) as opacity, and polygons as triangles.
///
/// Only data that `options` select are kept. Errors: `Malformed` for a broken file, naming the place;
/// `Unsupported` for Gaussians and point clouds.
pub fn read(mut source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    let header = header::read(&mut source)?;
    let path = &source.path;
    let faces = faces(path, &header)?;
    let mut warnings = Vec::new();
    let comments = header.comments.iter().map(String::as_str);
    let provenance = provenance::from_comments(comments, &mut warnings);
    let is_soup = soup::is_soup(faces);
    // Faces of a soup are triangles, because each has one opacity and one σ.
    let wanted = if is_soup { Wanted::Triangles } else { Wanted::Polygons };
    let tables = locate(&source, &header, wanted, &options.limits)?;
    let cameras = tables.views.as_ref().map(|table| corners::read(table, &options.limits));
    let cameras = cameras.transpose()?.unwrap_or_default();
    // Cameras are in single precision, so a soup with cameras is near its origin already.
    let origin = if cameras.is_empty() { corners::origin(&tables.vertices)? } else { DVec3::ZERO };
    let scene = if is_soup {
        let mut soup = soup::read(path, faces, &tables, origin, options)?;
        if soup.shell.is_empty() {
            let comments = header.comments.iter().map(String::as_str);
            soup.set_shell(0..provenance::shell_of_comments(comments));
        }
        Scene::Soup(soup)
    } else {
        Scene::Mesh(mesh::read(path, &tables, origin, &options.limits, &mut warnings)?)
    };
    let mut loaded = ImportedScene { scene, provenance, warnings, cameras };
    note_origin(&mut loaded, origin);
    finish(path, loaded)
}

/// Whether a PLY holds Gaussians instead of triangles.
///
/// Errors: a broken header.
pub fn holds_splats(source: &mut Source) -> Result<bool> {
    let header = header::read(source)?;
    source.rewind().map_err(|e| Error::io(&source.path, e))?;
    let has_faces = header.element("face").is_some_and(|faces| faces.rows > 0);
    Ok(!has_faces && header.element("vertex").is_some_and(splats::are_in))
}

/// The Gaussians in a PLY file, plain or compressed.
///
/// Errors: `Malformed` for a broken file, naming the place.
pub fn read_splats(mut source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let header = header::read(&mut source)?;
    let mut warnings = Vec::new();
    let comments = header.comments.iter().map(String::as_str);
    let provenance = provenance::from_comments(comments, &mut warnings);
    let packed = header.element("vertex").is_some_and(|vertices| vertices.has("packed_position"));
    let (splats, origin) = match packed {
        true => (packed_splats::read(&source, &header, options)?, DVec3::ZERO),
        false => splats::read(&source, &header, options)?,
    };
    build::finish(&source.path, splats, provenance, warnings, origin)
}

/// The face element, or why the file has no usable triangles.
fn faces<'h>(path: &Path, header: &'h Header) -> Result<&'h Element> {
    let Some(vertices) = header.element("vertex") else {
        return Err(Error::malformed(path, "header", "has no element vertex"));
    };
    let faces = header.element("face").filter(|faces| faces.rows > 0);
    match faces {
        Some(faces) => Ok(faces),
        None if splats::are_in(vertices) => Err(gaussians::refusal(path, "PLY")),
        None if header.element("tristrips").is_some() => {
            Err(Error::unsupported(path, "holds triangle strips; save it with separate triangles"))
        }
        None if header.element("face").is_some() => {
            Err(Error::malformed(path, "element face", "has no rows: there are no triangles in the file"))
        }
        None => Err(Error::unsupported(
            path,
            "is a point cloud: it has no element face; give a triangle mesh or a trained scene",
        )),
    }
}

// ---- The elements of a PLY that are read, and the places of their rows -------------------------------

/// The two elements of every triangle PLY, and the optional cameras of a soup.
pub(super) struct Tables<'a> {
    pub(super) vertices: Table<'a>,
    pub(super) faces: Table<'a>,
    pub(super) views: Option<Table<'a>>,
}

/// Finds the rows of `vertex`, `face` and `view`, checking that the file is as long as they need. `faces`
/// says which faces are permitted.
fn locate<'a>(source: &'a Source, header: &'a Header, faces: Wanted, limits: &Limits) -> Result<Tables<'a>> {
    check_rows(source, header, limits)?;
    let cameras = corners::element(header);
    let wanted = |element: &Element| match element.name.as_str() {
        "vertex" => Wanted::Triangles,
        "face" => faces,
        _ if cameras == Some(element) => Wanted::Triangles,
        _ => Wanted::Nothing,
    };
    let missing = |name: &str| Error::malformed(&source.path, "header", format!("has no element {name}"));
    let [vertices, faces, views] = open(source, header, wanted, ["vertex", "face", corners::NAME])?;
    Ok(Tables {
        vertices: vertices.ok_or_else(|| missing("vertex"))?,
        faces: faces.ok_or_else(|| missing("face"))?,
        views,
    })
}

/// Refuses more rows than a scene may have, before any is read.
fn check_rows(source: &Source, header: &Header, limits: &Limits) -> Result<()> {
    let place = |element: &Element| format!("{}: element {}", source.path.display(), element.name);
    header.element("face").map_or(Ok(()), |face| limits.triangles(place(face), face.rows))?;
    header.element("vertex").map_or(Ok(()), |vertex| limits.vertices(place(vertex), vertex.rows))
}

/// Only the rows of `vertex`: a cloud of points.
pub fn points<'a>(source: &'a Source, header: &'a Header, limits: &Limits) -> Result<Table<'a>> {
    let [vertices] = some(source, header, ["vertex"], limits)?;
    vertices.ok_or_else(|| Error::malformed(&source.path, "header", "has no element vertex"))
}

/// The rows of elements that have no lists which are read; `None` for those that the file lacks.
pub(super) fn some<'a, const N: usize>(
    source: &'a Source,
    header: &'a Header,
    names: [&str; N],
    limits: &Limits,
) -> Result<[Option<Table<'a>>; N]> {
    check_rows(source, header, limits)?;
    let wanted = |element: &Element| match names.contains(&element.name.as_str()) {
        true => Wanted::Triangles,
        false => Wanted::Nothing,
    };
    open(source, header, wanted, names)
}

/// Walks the elements of a file up to the last needed one; returns those of `names` that exist.
fn open<'a, const N: usize>(
    source: &'a Source,
    header: &'a Header,
    wanted: impl Fn(&Element) -> Wanted,
    names: [&str; N],
) -> Result<[Option<Table<'a>>; N]> {
    let mut tables = [const { None }; N];
    let mut at = header.body;
    let last = header.elements.iter().rposition(|e| wanted(e) != Wanted::Nothing).map_or(0, |last| last + 1);
    for element in &header.elements[..last] {
        let used = wanted(element);
        let (table, end) = Table::open(source, header.encoding, element, at, used)?;
        at = end;
        if used != Wanted::Nothing
            && let Some(slot) = names.iter().position(|name| *name == element.name)
        {
            tables[slot] = Some(table);
        }
    }
    Ok(tables)
}
