//! PLY: our soup PLY, and triangle meshes with vertex or face colours.

mod column;
mod corners;
mod encode;
pub mod header;
mod mesh;
mod soup;
mod table;
mod tables;
mod transcode;
mod views;

pub use column::Column;
pub use mesh::write_mesh;
pub use soup::{SoupWriter, write_soup};
pub use tables::points;

use super::far::note_origin;
use super::finish::finish;
use super::gaussians;
use super::provenance;
use super::read_options::ReadOptions;
use super::source::Source;
use glam::DVec3;
use header::{Element, Header};
use std::path::Path;
use transcode::Wanted;
use trisplat_scene::error::{Error, Result};
use trisplat_scene::scene::{Loaded, Scene};

/// The scene in a PLY file: a soup when its faces have a `sigma`, else a mesh with its sRGB colours made
/// linear, alpha (of a face, or the least of its corners) as opacity, and polygons as triangles.
///
/// Only data that `options` select are kept. Errors: `Malformed` for a broken file, naming the place;
/// `Unsupported` for Gaussians and point clouds.
pub fn read(mut source: Source, options: &ReadOptions) -> Result<Loaded> {
    let header = header::read(&mut source)?;
    let path = &source.path;
    let faces = faces(path, &header)?;
    let mut warnings = Vec::new();
    let comments = header.comments.iter().map(String::as_str);
    let provenance = provenance::from_comments(comments, &mut warnings);
    let is_soup = soup::is_soup(faces);
    // Faces of a soup are triangles, because each has one opacity and one σ.
    let wanted = if is_soup { Wanted::Triangles } else { Wanted::Polygons };
    let tables = tables::locate(&source, &header, wanted, &options.limits)?;
    let cameras = tables.views.as_ref().map(|table| views::read(table, &options.limits));
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
    let mut loaded = Loaded { scene, provenance, warnings, cameras };
    note_origin(&mut loaded, origin);
    finish(path, loaded)
}

/// The face element, or why the file has no usable triangles.
fn faces<'h>(path: &Path, header: &'h Header) -> Result<&'h Element> {
    let Some(vertices) = header.element("vertex") else {
        return Err(Error::malformed(path, "header", "has no element vertex"));
    };
    let faces = header.element("face").filter(|faces| faces.rows > 0);
    let is_gaussians = ["scale_0", "rot_0", "packed_position"].iter().any(|p| vertices.has(p));
    match faces {
        Some(faces) => Ok(faces),
        None if is_gaussians => Err(gaussians::refusal(path, "PLY")),
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
