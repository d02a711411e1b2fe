//! PLY: our soup PLY, and triangle meshes with vertex or face colours.

use crate::finish::finish;
use crate::splats::kinds;
use crate::{ReadOptions, Source, format, lines};
use glam::DVec3;
pub use header::Column;
use header::{Element, PlyHeader};
pub use mesh::write_mesh;
pub use soup::{SoupWriter, write_soup};
use std::path::Path;
pub use table::points;
use trisplat_scene::{Error, ImportedScene, ImportedSplats, Result, Scene, UpAxis};

pub mod header;
mod mesh;
mod soup;
mod splats;
mod table;
mod transcode;

/// A program that writes this format with its own up axis.
const MODELLING: [(&str, UpAxis); 1] = [("blender", UpAxis::Z)];
/// Programs that leave meshes in the frame of their cameras, COLMAP's as a rule.
const RECONSTRUCTION: [(&str, UpAxis); 4] = [
    ("open3d", UpAxis::NegY),
    ("colmap", UpAxis::NegY),
    ("openmvs", UpAxis::NegY),
    ("poisson", UpAxis::NegY),
];
/// Beginning of the names that COLMAP gives its meshes.
const MESHED: &[u8] = b"meshed-";

/// The scene in a PLY file: a soup when its faces have a `sigma`, else a mesh with its sRGB colours
/// made linear, alpha (of a face, or the least of its corners) as opacity, and polygons as
/// triangles.
///
/// Only data that `options` select are kept.
///
/// # Errors
///
/// `Malformed` for a broken file, naming the place; `Unsupported` for Gaussians and point clouds.
pub fn read(mut source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    let header = header::read(&mut source)?;
    let path = &source.path;
    let is_soup = soup::is_soup(faces(path, &header)?);
    let mut warnings = Vec::new();
    let comments = header.comments.iter().map(String::as_str);
    let mut provenance = lines::from_comments(comments.clone(), &mut warnings);
    if !is_soup && provenance.up.is_none() {
        let is_colmap =
            path.file_stem().is_some_and(|name| name.as_encoded_bytes().starts_with(MESHED));
        let by_program = lines::up_of_program(comments.clone(), &RECONSTRUCTION);
        provenance.usual_up = (!is_colmap).then_some(by_program.unwrap_or(UpAxis::Y));
        provenance.up = lines::up_of_program(comments, &MODELLING);
    }
    // Faces of a soup are triangles, because each has one opacity and one σ.
    let names = ["vertex", "face", soup::view_name(&header)];
    let [vertices, faces, views] = table::open(&source, &header, names, !is_soup, &options.limits)?;
    let vertices = table::required(vertices, &source, "vertex")?;
    let faces = table::required(faces, &source, "face")?;
    let cameras =
        views.map_or(Ok(Vec::new()), |table| soup::read_views(&table, &options.limits))?;
    // Cameras are in single precision, so a soup with cameras is near its origin already.
    let origin = if cameras.is_empty() { vertices.origin()? } else { DVec3::ZERO };
    let scene = if is_soup {
        Scene::Soup(soup::read(&vertices, &faces, origin, options)?)
    } else {
        Scene::Mesh(mesh::read(
            &vertices,
            &faces,
            origin,
            &header.comments,
            options,
            &mut warnings,
        )?)
    };
    // Triangles with vertices of their own are those of a soup, in the frame of its cameras.
    if matches!(&scene, Scene::Mesh(mesh) if mesh.indices.is_empty()) {
        provenance.usual_up = None;
    }
    let loaded = ImportedScene { scene, provenance, warnings, cameras };
    finish(path, loaded, origin)
}

/// True when a PLY holds Gaussians instead of triangles.
///
/// # Errors
///
/// A broken header.
pub fn holds_splats(source: &mut Source) -> Result<bool> {
    let header = header::read(source)?;
    source.rewind()?;
    let has_faces = header.element("face").is_some_and(|faces| faces.rows > 0);
    Ok(!has_faces && header.element("vertex").is_some_and(splats::are_in))
}

/// The Gaussians in a PLY file, plain or compressed.
///
/// # Errors
///
/// `Malformed` for a broken file, naming the place.
pub fn read_splats(mut source: Source, options: &ReadOptions) -> Result<ImportedSplats> {
    let header = header::read(&mut source)?;
    let mut warnings = Vec::new();
    let comments = header.comments.iter().map(String::as_str);
    let provenance = lines::from_comments(comments, &mut warnings);
    if let Some(vertices) = header.element("vertex") {
        let elements: Vec<&str> = header.elements.iter().map(|one| one.name.as_str()).collect();
        let columns = vertices.columns();
        if let Some(error) = kinds::refusal(&source.path, &elements, &columns) {
            return Err(error);
        }
        let names: Vec<&str> = columns.iter().map(|(name, _)| *name).collect();
        warnings.extend(kinds::warnings(&source.path, &names));
    }
    let packed = header.element("vertex").is_some_and(|vertices| vertices.has("packed_position"));
    let (splats, origin) = if packed {
        (splats::read_packed(&source, &header, options)?, DVec3::ZERO)
    } else {
        splats::read(&source, &header, options, &mut warnings)?
    };
    crate::splats::finish(&source.path, splats, provenance, warnings, origin)
}

/// The face element, or the error of a file without usable triangles.
fn faces<'h>(path: &Path, header: &'h PlyHeader) -> Result<&'h Element> {
    let Some(vertices) = header.element("vertex") else {
        return Err(Error::malformed(path, "header", "has no element vertex"));
    };
    let faces = header.element("face").filter(|faces| faces.rows > 0);
    match faces {
        Some(faces) => Ok(faces),
        None if splats::are_in(vertices) => Err(format::refusal(path, "PLY")),
        None if header.element("tristrips").is_some() => {
            Err(Error::unsupported(path, "holds triangle strips; save it with separate triangles"))
        }
        None if header.element("face").is_some() => Err(Error::malformed(
            path,
            "element face",
            "has no rows: there are no triangles in the file",
        )),
        None => Err(Error::unsupported(
            path,
            "is a point cloud: it has no element face; give a triangle mesh or a trained scene",
        )),
    }
}
