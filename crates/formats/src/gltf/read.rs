//! Reads the triangles of a file's default scene as one mesh.
//!
//! The document may be hostile: every number is checked before use, memory is allocated only for bytes that
//! exist, and no file unpacks to more than 1024 times its size.

use super::accessor::Accessors;
use super::buffers::Buffers;
use super::container::ContainerFile;
use super::document::{self, Document};
use super::extensions::{INSTANCING, is_readable};
use super::extras;
use super::merge::MergedMesh;
use super::nodes::{self, MeshInstance};
use super::part;
use crate::far::note_origin;
use crate::{ReadOptions, Source, finish, foreign, gaussians};
use std::path::Path;
use trisplat_scene::{Error, ImportedScene, Provenance, Result, Scene};

/// The triangles of the default scene as one mesh: all nodes placed, all primitives merged, colours
/// linear.
///
/// Colours are one per face when no faces share vertices and each has one colour, so that files of this
/// program read back unchanged.
///
/// # Errors
/// `Malformed` for broken containers, JSON and accessors; `Unsupported` for glTF 1.0, Draco, unknown
/// required extensions and scenes without triangles.
pub fn read(mut source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    let path = source.path.clone();
    let limits = &options.limits;
    let container = ContainerFile::read(&mut source, limits)?;
    let document: Document = document::parse(&path, &container.json, limits)
        .and_then(|document| check_support(&path, &document).map(|()| document))
        .map_err(|error| foreign::refusal(&path, &container.json).unwrap_or(error))?;
    let mut instances = nodes::instances(&path, &document, limits)?;
    let buffers = Buffers::new(source, &container, &document.buffers, options);
    drop(container);
    let srgb = extras::has_srgb_colors(&document.asset);
    let mut merged = MergedMesh::new(&document, Accessors::new(&document, buffers), srgb, *limits);
    for node in &document.nodes {
        if node.skin.is_some() {
            merged.warn("skins are not applied");
        }
        if node.extensions.contains_key(INSTANCING) {
            merged.warn(format!("{INSTANCING} is not read: its meshes are drawn once"));
        }
    }
    merged.reserve(&instances)?;
    let origin = merged.origin(&instances)?;
    nodes::take_off(&mut instances, origin);
    // The backdrop comes last, even if another program has moved it.
    let is_backdrop =
        |i: &&MeshInstance| document.nodes[i.node].name.as_deref().is_some_and(part::is_backdrop);
    for instance in instances.iter().filter(|i| !is_backdrop(i)) {
        merged.add(instance)?;
    }
    let scene_faces = merged.face_count();
    for instance in instances.iter().filter(is_backdrop) {
        merged.add(instance)?;
    }
    let backdrop = (merged.face_count() - scene_faces) as u32;
    if merged.face_count() == 0
        && document.extensions_used.iter().any(|name| name == gaussians::GLTF_EXTENSION)
    {
        return Err(gaussians::refusal(&path, "glTF"));
    }
    let (mesh, warnings) = merged.finish()?;
    let provenance = Provenance { backdrop, ..extras::provenance(&document.asset) };
    let mut loaded = ImportedScene { scene: Scene::Mesh(mesh), provenance, warnings, cameras: Vec::new() };
    note_origin(&mut loaded, origin);
    finish(&path, loaded)
}

pub(crate) fn check_support(path: &Path, document: &Document) -> Result<()> {
    if !document.asset.version.starts_with("2.") {
        return Err(Error::unsupported(
            path,
            format!("is glTF {:?}; convert it to glTF 2.0", document.asset.version),
        ));
    }
    let unknown = document.extensions_required.iter().find(|name| !is_readable(name));
    match unknown {
        Some(name) if name.starts_with(gaussians::GLTF_EXTENSION) => Err(gaussians::refusal(path, "glTF")),
        Some(name) => {
            Err(Error::unsupported(path, format!("requires the extension {name}; export it again without")))
        }
        None => Ok(()),
    }
}
