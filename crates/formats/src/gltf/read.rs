//! Reads the triangles of a file's default scene as one mesh.
//!
//! The document may be hostile: every number is checked before use, memory is allocated only for
//! bytes that exist, and no file unpacks to more than 1024 times its size.

use super::accessor::Accessors;
use super::buffers::Buffers;
use super::container::ContainerFile;
use super::document::{
    self, GltfDocument, GltfMesh, INSTANCING, MeshInstance, Primitive, instances, is_readable,
    subtract_origin,
};
use super::merge::MergedMesh;
use super::{compose, part};
use crate::finish::finish;
use crate::{ReadOptions, Source, format};
use glam::{DMat4, DQuat, DVec3, DVec4};
use gltf_json::mesh::TRIANGLES;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::Path;
use trisplat_scene::{Error, ImportedScene, Limits, Provenance, Result, Scene};

/// The triangles of the default scene as one mesh: all nodes placed, all primitives merged, colours
/// linear.
///
/// Colours are one per face when no faces share vertices and each has one colour, so that files of
/// this program read back unchanged.
///
/// # Errors
/// `Malformed` for broken containers, JSON and accessors; `Unsupported` for glTF 1.0, Draco,
/// unknown required extensions and scenes without triangles.
pub fn read(mut source: Source, options: &ReadOptions) -> Result<ImportedScene> {
    let path = source.path.clone();
    let limits = &options.limits;
    let container = ContainerFile::read(&mut source, limits)?;
    let document: GltfDocument = document::parse(&path, &container.json, limits)
        .and_then(|document| check_support(&path, &document).map(|()| document))
        .map_err(|error| crate::foreign_json(&path, &container.json).unwrap_or(error))?;
    let instances = instances(&path, &document, limits)?;
    let buffers = Buffers::new(source, &container, &document.buffers, options);
    drop(container);
    let mut accessors = Accessors::new(&document, buffers);
    check_triangles(&document, &mut accessors, &instances, limits)?;
    let mut instances = with_copies(&document, &mut accessors, instances, limits)?;
    let srgb = compose::has_srgb_colors(&document.asset);
    let mut merged = MergedMesh::new(&document, accessors, srgb, *limits);
    let unread = |name: &&String| !is_readable(name);
    let unread: Vec<&str> =
        document.extensions_used.iter().filter(unread).map(String::as_str).collect();
    if !unread.is_empty() {
        merged.warn(format!("extensions are not read: {}", unread.join(", ")));
    }
    for node in &document.nodes {
        if node.extensions.instancing.as_ref().is_some_and(|copies| copies.attributes.is_empty()) {
            merged.warn(format!("{INSTANCING} without attributes: the mesh is drawn once"));
        }
    }
    let origin = merged.reserve(&instances)?;
    subtract_origin(&mut instances, origin);
    merged.read_skins(origin)?;
    // The backdrop comes last, even if another program has moved it.
    let is_backdrop =
        |i: &&MeshInstance| document.nodes[i.node].name.as_deref().is_some_and(part::is_backdrop);
    for instance in instances.iter().filter(|i| !is_backdrop(i)) {
        merged.add(instance)?;
    }
    let scene_faces = merged.faces;
    for instance in instances.iter().filter(is_backdrop) {
        merged.add(instance)?;
    }
    let backdrop_faces = (merged.faces - scene_faces) as u32;
    let mut extensions = document.extensions_used.iter().chain(&document.extensions_required);
    if merged.faces == 0
        && let Some(name) = extensions.clone().find(|name| format::is_draft(name))
    {
        return Err(format::draft(&path, name));
    }
    if merged.faces == 0 && extensions.any(|name| name.starts_with(format::GLTF_EXTENSION)) {
        return Err(format::refusal(&path, "glTF"));
    }
    let (mesh, warnings) = merged.finish(options)?;
    let provenance = Provenance { backdrop_faces, ..compose::provenance(&document.asset) };
    let loaded =
        ImportedScene { scene: Scene::Mesh(mesh), provenance, warnings, cameras: Vec::new() };
    finish(&path, loaded, origin)
}

/// Refuse more triangles than the limit by the counts of the document, before anything is read. A
/// primitive without triangles counts as one.
fn check_triangles(
    document: &GltfDocument,
    accessors: &mut Accessors,
    instances: &[MeshInstance],
    limits: &Limits,
) -> Result<()> {
    let mut count = |accessor: usize| accessors.layout(accessor).map_or(0, |layout| layout.count);
    let mut of_primitive = |primitive: &Primitive| {
        let corners = primitive.indices.or(primitive.attributes.position).map_or(0, &mut count);
        match primitive.mode {
            TRIANGLES => (corners / 3).max(1),
            _ => corners.saturating_sub(2).max(1),
        }
    };
    let sum = |mesh: &GltfMesh| {
        mesh.primitives.iter().map(&mut of_primitive).fold(0, u64::saturating_add)
    };
    let of_mesh: Vec<u64> = document.meshes.iter().map(sum).collect();
    let mut total = 0u64;
    for instance in instances {
        let copies = document.nodes[instance.node].extensions.instancing.as_ref();
        let copies =
            copies.and_then(|copies| copies.attributes.values().next()).map_or(1, |at| count(*at));
        let triangles = of_mesh.get(instance.mesh).copied().unwrap_or(0);
        total = total.saturating_add(triangles.saturating_mul(copies));
    }
    limits.triangles(accessors.buffers.path().display(), total)
}

/// The instances, each as often as its node copies it.
fn with_copies(
    document: &GltfDocument,
    accessors: &mut Accessors,
    instances: Vec<MeshInstance>,
    limits: &Limits,
) -> Result<Vec<MeshInstance>> {
    let before = instances.len();
    let mut all = Vec::with_capacity(instances.len());
    for instance in instances {
        let copies = document.nodes[instance.node].extensions.instancing.as_ref();
        let Some(copies) =
            copies.map(|copies| &copies.attributes).filter(|copies| !copies.is_empty())
        else {
            all.push(instance);
            continue;
        };
        let node = instance.transform.unwrap_or(DMat4::IDENTITY);
        let copies = read_copies(accessors, copies, instance.node, limits)?;
        all.extend(copies.into_iter().map(|copy| {
            let transform =
                DMat4::from_scale_rotation_translation(copy.scale, copy.rotation, copy.translation);
            MeshInstance { transform: Some(node * transform), ..instance }
        }));
    }
    if let Some(odd) =
        all.iter().find(|one| one.transform.is_some_and(|transform| !transform.is_finite()))
    {
        let place = format!("node {}", odd.node);
        return Err(Error::malformed(
            accessors.buffers.path(),
            place,
            "has a transform that is not finite",
        ));
    }
    accessors.buffers.repeat(1 + (all.len().saturating_sub(before)) as u64);
    Ok(all)
}

/// Transform of one copy of a node's mesh, relative to the node.
#[derive(Clone, Copy)]
struct NodeCopy {
    scale: DVec3,
    rotation: DQuat,
    translation: DVec3,
}

/// The copies of a node's mesh.
///
/// # Errors
///
/// Attributes of unequal length; more copies than a scene may have triangles.
fn read_copies(
    accessors: &mut Accessors,
    attributes: &BTreeMap<String, usize>,
    node: usize,
    limits: &Limits,
) -> Result<Vec<NodeCopy>> {
    let place = format!("node {node}: {INSTANCING}");
    let counts = attributes.values().map(|accessor| Ok(accessors.layout(*accessor)?.count));
    let counts = counts.collect::<Result<Vec<u64>>>()?;
    if counts.iter().any(|count| *count != counts[0]) {
        let path = accessors.buffers.path();
        return Err(Error::malformed(
            path,
            place,
            format!("has attributes of unequal length: {counts:?}"),
        ));
    }
    limits.triangles(format_args!("{}: {place}", accessors.buffers.path().display()), counts[0])?;
    accessors.buffers.spend(counts[0].saturating_mul(size_of::<MeshInstance>() as u64 + 80))?;
    let identity =
        NodeCopy { scale: DVec3::ONE, rotation: DQuat::IDENTITY, translation: DVec3::ZERO };
    let mut copies = vec![identity; counts[0] as usize];
    for (name, &accessor) in attributes {
        match name.as_str() {
            "SCALE" => accessors.for_each(accessor, 0.0, |i, scale| {
                copies[i].scale = DVec3::from(scale);
            })?,
            "ROTATION" => accessors.for_each(accessor, 0.0, |i, xyzw: [f64; 4]| {
                copies[i].rotation =
                    DVec4::from(xyzw).try_normalize().map_or(DQuat::IDENTITY, DQuat::from_vec4);
            })?,
            "TRANSLATION" => accessors.for_each(accessor, 0.0, |i, offset| {
                copies[i].translation = DVec3::from(offset);
            })?,
            _ => {}
        }
    }
    Ok(copies)
}

pub(crate) fn check_support(path: &Path, document: &GltfDocument) -> Result<()> {
    if !document.asset.version.starts_with("2.") {
        return Err(Error::unsupported(
            path,
            format!("is glTF {:?}; convert it to glTF 2.0", document.asset.version),
        ));
    }
    let unknown = document.extensions_required.iter().find(|name| !is_readable(name));
    match unknown {
        Some(name) if format::is_draft(name) => Err(format::draft(path, name)),
        Some(name) if name.starts_with(format::GLTF_EXTENSION) => Err(format::unread(path, name)),
        Some(name) => Err(Error::unsupported(
            path,
            format!("requires the extension {name}; export it again without"),
        )),
        None => Ok(()),
    }
}

// ---- Counts and extensions of a document --------------------------------------------------------

/// Content of a glTF document.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GltfInfo {
    /// The program that wrote it.
    pub generator: Option<String>,
    /// Extensions it uses.
    pub extensions_used: Vec<String>,
    /// Extensions a reader must know.
    pub extensions_required: Vec<String>,
    /// Number of nodes.
    pub nodes: u64,
    /// Number of meshes.
    pub meshes: u64,
    /// Number of primitives of all meshes.
    pub primitives: u64,
    /// Number of materials.
    pub materials: u64,
}

/// Counts and extensions of the document of an open file.
///
/// # Errors
///
/// A broken container or document; errors of the operating system.
pub(crate) fn gltf_info(mut source: Source, limits: &Limits) -> Result<GltfInfo> {
    let container = ContainerFile::read(&mut source, limits)?;
    let document: GltfDocument = document::parse(&source.path, &container.json, limits)?;
    Ok(GltfInfo {
        nodes: document.nodes.len() as u64,
        meshes: document.meshes.len() as u64,
        primitives: document.meshes.iter().map(|mesh| mesh.primitives.len() as u64).sum(),
        materials: document.materials.len() as u64,
        generator: document.asset.generator,
        extensions_used: document.extensions_used,
        extensions_required: document.extensions_required,
    })
}
