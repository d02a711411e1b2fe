//! PLY: our soup PLY, and triangle meshes with vertex or face colours.

mod corners;
mod header;
mod mesh;
mod soup;
mod table;
mod transcode;
mod views;

pub use mesh::write_mesh;
pub use soup::write_soup;

use super::blocks::write_blocks;
use super::{ReadOptions, Source, finish, provenance};
use crate::error::{Error, Result};
use crate::scene::{Loaded, Scene};
use header::{Element, Header};
use std::io::{self, Write};
use std::path::Path;

/// The scene in a PLY file: a soup when its faces have a `sigma`, else a mesh with its sRGB colours
/// made linear, alpha (at a face, or the least of its corners) as opacity.
///
/// Only what `options` asks for is kept. Errors: `Malformed` for a broken file, naming the place;
/// `Unsupported` for Gaussians and point clouds.
pub fn read(mut source: Source, options: &ReadOptions) -> Result<Loaded> {
    let header = header::read(&mut source)?;
    let path = &source.path;
    let faces = faces(path, &header)?;
    let mut warnings = Vec::new();
    let comments = header.comments.iter().map(String::as_str);
    let provenance = provenance::from_comments(comments, &mut warnings);
    let tables = table::locate(&source, &header)?;
    let scene = if soup::is_soup(faces) {
        Scene::Soup(soup::read(path, faces, &tables, options.sh_degree)?)
    } else {
        Scene::Mesh(mesh::read(path, &tables, &mut warnings)?)
    };
    let cameras = tables.views.as_ref().map(views::read).transpose()?.unwrap_or_default();
    finish(path, Loaded { scene, provenance, warnings, cameras })
}

/// The face element, or why the file has no triangles for us.
fn faces<'h>(path: &Path, header: &'h Header) -> Result<&'h Element> {
    let Some(vertices) = header.element("vertex") else {
        return Err(Error::malformed(path, "header", "has no element vertex"));
    };
    let faces = header.element("face").filter(|faces| faces.rows > 0);
    let gaussians = ["scale_0", "rot_0", "packed_position"].iter().any(|p| vertices.has(p));
    match faces {
        Some(faces) => Ok(faces),
        None if gaussians => Err(Error::unsupported(
            path,
            "holds 3D Gaussians, not triangles; train a triangle scene from the same photos with `trisplat train`",
        )),
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

/// Floats as they stand in a binary little-endian file.
fn write_floats(out: &mut dyn Write, floats: &[f32]) -> io::Result<()> {
    if cfg!(target_endian = "little") {
        return out.write_all(bytemuck::cast_slice(floats));
    }
    write_blocks(out, floats.len(), |i, block| block.extend_from_slice(&floats[i].to_le_bytes()))
}

/// A triangle's `list uchar int vertex_indices`.
fn push_corners(block: &mut Vec<u8>, corners: [u32; 3]) {
    block.push(3);
    for corner in corners {
        block.extend_from_slice(&corner.to_le_bytes());
    }
}

fn push_comment(header: &mut String, comment: &str) {
    if !comment.is_empty() {
        *header += &format!("comment {comment}\n");
    }
}
