//! The JSON document as it is read: only the glTF objects of a triangle scene.
//!
//! `gltf-json` has types for all of them, and two are used (the asset, the buffers). The others are
//! this crate's own, because `gltf-json` 1.4 loses information, as shown by tests in
//! `crates/formats/tests/formats/gltf_read/gltf_json.rs`:
//!
//! - Indices, modes and component types are taken modulo 2^32: mesh 4294967296 reads as mesh 0.
//! - A scene without `nodes`, which glTF allows, is refused.
//! - Unknown component types and accessor types are dropped, so a message could not name them.
//! - The whole file must be valid: a fault in an animation, a sampler or a skin hides a good mesh.
//! - Three bytes of JSON (`{}` and a comma) make a material of 752 bytes, and no array has a limit.
//!
//! The crate `gltf` reads through these types, so it loses the same.

use super::material::{GltfMaterial, GltfTexture, Sampler, lenient};
use super::meshopt::{CompressedView, MESHOPT, MESHOPT_KHR};
use crate::finish::is_far;
use crate::format;
use glam::{DMat4, DQuat, DVec3, Vec3};
use gltf_json::accessor::{self, ComponentType};
use gltf_json::mesh;
use serde::Deserialize;
use serde::de::{DeserializeOwned, Deserializer, Error as _, IgnoredAny, SeqAccess, Visitor};
use serde_json::value::RawValue;
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fmt;
use std::marker::PhantomData;
use std::path::Path;
use trisplat_scene::input::BYTE_ORDER_MARK;
use trisplat_scene::{Error, Limits, Result};

/// Names of extensions, without their content.
type Names = BTreeMap<String, IgnoredAny>;

/// A glTF 2.0 document.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct GltfDocument {
    pub(crate) asset: gltf_json::Asset,
    pub(crate) scene: Option<usize>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) scenes: Vec<GltfScene>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) nodes: Vec<GltfNode>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) meshes: Vec<GltfMesh>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) materials: Vec<GltfMaterial>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) accessors: Vec<Accessor>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) textures: Vec<GltfTexture>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) samplers: Vec<Sampler>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) skins: Vec<GltfSkin>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) images: Vec<GltfImage>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) buffer_views: Vec<BufferView>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) buffers: Vec<gltf_json::Buffer>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) extensions_used: Vec<String>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) extensions_required: Vec<String>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct GltfScene {
    #[serde(default, deserialize_with = "limited")]
    pub(crate) nodes: Vec<usize>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct GltfNode {
    pub(crate) name: Option<String>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) children: Vec<usize>,
    pub(crate) mesh: Option<usize>,
    pub(crate) skin: Option<usize>,
    pub(crate) matrix: Option<[f64; 16]>,
    pub(crate) translation: Option<[f64; 3]>,
    pub(crate) rotation: Option<[f32; 4]>,
    pub(crate) scale: Option<[f32; 3]>,
    #[serde(default)]
    pub(crate) extensions: NodeExtensions,
}

/// Nodes that move the vertices of a mesh.
#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct GltfSkin {
    #[serde(default, deserialize_with = "lenient")]
    pub(crate) inverse_bind_matrices: Option<usize>,
    #[serde(default, deserialize_with = "limited")]
    pub(crate) joints: Vec<usize>,
}

#[derive(Debug, Default, Deserialize)]
pub(crate) struct NodeExtensions {
    #[serde(default, rename = "KHR_node_visibility", deserialize_with = "lenient")]
    visibility: Option<Visibility>,
    #[serde(default, rename = "EXT_mesh_gpu_instancing", deserialize_with = "lenient")]
    pub(crate) instancing: Option<Instancing>,
}

/// Visibility of a node and all below it.
#[derive(Debug, Deserialize)]
struct Visibility {
    visible: Option<bool>,
}

impl GltfNode {
    fn is_hidden(&self) -> bool {
        self.extensions.visibility.as_ref().is_some_and(|shown| shown.visible == Some(false))
    }
}

/// Accessors with a number for each copy of a node's mesh.
#[derive(Debug, Deserialize)]
pub(crate) struct Instancing {
    #[serde(default)]
    pub(crate) attributes: BTreeMap<String, usize>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct GltfMesh {
    #[serde(default, deserialize_with = "limited")]
    pub(crate) primitives: Vec<Primitive>,
}

#[derive(Debug, Deserialize)]
pub(crate) struct Primitive {
    #[serde(default)]
    pub(crate) attributes: Attributes,
    pub(crate) indices: Option<usize>,
    pub(crate) material: Option<usize>,
    #[serde(default = "triangles")]
    pub(crate) mode: u32,
    #[serde(default)]
    pub(crate) targets: Vec<IgnoredAny>,
    #[serde(default)]
    pub(crate) extensions: Names,
}

/// Accessor numbers of the attributes that are read.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(crate) position: Option<usize>,
    #[serde(rename = "COLOR_0")]
    pub(crate) color: Option<usize>,
    #[serde(rename = "TEXCOORD_0")]
    tex_coord: Option<usize>,
    #[serde(rename = "TEXCOORD_1")]
    tex_coord_1: Option<usize>,
    #[serde(rename = "TEXCOORD_2")]
    tex_coord_2: Option<usize>,
    #[serde(rename = "TEXCOORD_3")]
    tex_coord_3: Option<usize>,
    #[serde(rename = "JOINTS_0")]
    pub(crate) joints: Option<usize>,
    #[serde(rename = "WEIGHTS_0")]
    pub(crate) weights: Option<usize>,
    #[serde(rename = "JOINTS_1")]
    pub(crate) more_joints: Option<usize>,
    #[serde(rename = "WEIGHTS_1")]
    pub(crate) more_weights: Option<usize>,
}

impl Attributes {
    /// The accessor of a set of texture coordinates.
    pub(crate) fn tex_coord(&self, set: usize) -> Option<usize> {
        *[self.tex_coord, self.tex_coord_1, self.tex_coord_2, self.tex_coord_3].get(set)?
    }
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct GltfImage {
    #[serde(default, deserialize_with = "lenient")]
    pub(crate) buffer_view: Option<usize>,
    #[serde(default, deserialize_with = "lenient")]
    pub(crate) uri: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: Option<usize>,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) component_type: u32,
    #[serde(default)]
    pub(crate) normalized: bool,
    pub(crate) count: u64,
    #[serde(rename = "type")]
    pub(crate) shape: String,
    pub(crate) sparse: Option<Sparse>,
}

/// Elements that replace elements of an accessor.
#[derive(Debug, Deserialize)]
pub(crate) struct Sparse {
    pub(crate) count: u64,
    pub(crate) indices: SparseIndices,
    pub(crate) values: SparseValues,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseIndices {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) component_type: u32,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct SparseValues {
    pub(crate) buffer_view: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
}

#[derive(Debug, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct BufferView {
    pub(crate) buffer: usize,
    #[serde(default)]
    pub(crate) byte_offset: u64,
    pub(crate) byte_length: u64,
    pub(crate) byte_stride: Option<u64>,
    #[serde(default)]
    pub(crate) extensions: ViewExtensions,
}

/// The extension of a view that is followed.
#[derive(Debug, Default)]
pub(crate) struct ViewExtensions {
    pub(crate) meshopt: Option<CompressedView>,
}

impl<'de> Deserialize<'de> for ViewExtensions {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let mut extensions = BTreeMap::<String, Box<RawValue>>::deserialize(deserializer)?;
        let meshopt = extensions.remove(MESHOPT).or_else(|| extensions.remove(MESHOPT_KHR));
        let parsed = meshopt.map(|text| serde_json::from_str(text.get())).transpose();
        Ok(Self { meshopt: parsed.map_err(D::Error::custom)?.flatten() })
    }
}

/// The default mode of a primitive.
fn triangles() -> u32 {
    mesh::TRIANGLES
}

/// The component type of that code.
pub(crate) fn component_type(code: u32) -> Option<ComponentType> {
    Some(match code {
        accessor::BYTE => ComponentType::I8,
        accessor::UNSIGNED_BYTE => ComponentType::U8,
        accessor::SHORT => ComponentType::I16,
        accessor::UNSIGNED_SHORT => ComponentType::U16,
        accessor::UNSIGNED_INT => ComponentType::U32,
        accessor::FLOAT => ComponentType::F32,
        _ => return None,
    })
}

/// Limit of the arrays of a document.
#[derive(Clone, Copy)]
struct ArrayLimit {
    /// Maximum number of entries of an array.
    max_entries: u64,
    /// Length of the first array beyond the limit, as far as it was read.
    exceeded: Option<u64>,
}

thread_local! {
    /// Limit of the document being parsed; thread-local, because serde passes no context to its
    /// functions.
    static ARRAY_LIMIT: Cell<ArrayLimit> =
        const { Cell::new(ArrayLimit { max_entries: 0, exceeded: None }) };
}

/// The document in `json`.
pub(crate) fn parse<T: DeserializeOwned>(path: &Path, json: &[u8], limits: &Limits) -> Result<T> {
    // Some writers pad with zeros instead of spaces.
    let end = json.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
    let json = json[..end].strip_prefix(BYTE_ORDER_MARK).unwrap_or(&json[..end]);
    ARRAY_LIMIT.set(ArrayLimit { max_entries: limits.nodes, exceeded: None });
    let parsed = serde_json::from_slice(json);
    if let Some(entries) = ARRAY_LIMIT.get().exceeded {
        limits.nodes(format_args!("{}: JSON", path.display()), entries)?;
    }
    parsed.map_err(|e| Error::malformed(path, "JSON", e.to_string()))
}

/// Entry `index` of a list of things called `kind`.
pub(crate) fn entry<'a, T>(path: &Path, kind: &str, list: &'a [T], index: usize) -> Result<&'a T> {
    list.get(index).ok_or_else(|| {
        let reason = format!("does not exist: the file has {}", list.len());
        Error::malformed(path, format!("{kind} {index}"), reason)
    })
}

/// An array within the [`ARRAY_LIMIT`].
pub(crate) fn limited<'de, D: Deserializer<'de>, T: Deserialize<'de>>(
    deserializer: D,
) -> Result<Vec<T>, D::Error> {
    struct Limited<T>(PhantomData<T>);
    impl<'de, T: Deserialize<'de>> Visitor<'de> for Limited<T> {
        type Value = Vec<T>;

        fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
            f.write_str("an array")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<Vec<T>, A::Error> {
            let max_entries = ARRAY_LIMIT.get().max_entries;
            let mut entries = Vec::new();
            while let Some(entry) = seq.next_element()? {
                if entries.len() as u64 == max_entries {
                    let exceeded = Some(max_entries + 1);
                    ARRAY_LIMIT.set(ArrayLimit { max_entries, exceeded });
                    return Err(A::Error::custom("too many entries"));
                }
                entries.push(entry);
            }
            Ok(entries)
        }
    }
    deserializer.deserialize_seq(Limited(PhantomData))
}

// ---- The node tree, with the place of every mesh ------------------------------------------------

/// A mesh shown by a node.
#[derive(Debug)]
pub(crate) struct MeshInstance {
    /// Number of the mesh.
    pub(crate) mesh: usize,
    /// Number of the node, for messages.
    pub(crate) node: usize,
    /// From the mesh to the scene; none for the identity.
    pub(crate) transform: Option<DMat4>,
}

/// Every drawn mesh of the default scene, in the order of the tree, with its transform accumulated
/// in f64.
///
/// # Errors
/// `Malformed` for indices out of range, for a node with two parents or in a cycle, and for
/// transforms that are not finite.
pub(crate) fn instances(
    path: &Path,
    document: &GltfDocument,
    limits: &Limits,
) -> Result<Vec<MeshInstance>> {
    let mut instances = Vec::new();
    walk(path, document, limits, |index, node, transform, is_hidden| {
        let is_collider = |name: &String| COLLIDERS.iter().any(|ending| name.ends_with(ending));
        if let Some(mesh) = node.mesh.filter(|_| !is_hidden)
            && !node.name.as_ref().is_some_and(is_collider)
        {
            instances.push(MeshInstance { mesh, node: index, transform });
        }
    })?;
    Ok(instances)
}

/// From each node to the scene; none for a node that is not in the default scene. `[N]`
///
/// # Errors
/// As [`instances`].
pub(crate) fn node_transforms(
    path: &Path,
    document: &GltfDocument,
    limits: &Limits,
) -> Result<Vec<Option<DMat4>>> {
    let mut transforms = vec![None; document.nodes.len()];
    walk(path, document, limits, |index, _, transform, _| {
        transforms[index] = Some(transform.unwrap_or(DMat4::IDENTITY));
    })?;
    Ok(transforms)
}

/// Hands every node of the default scene to `each`, parents first, with its number, its accumulated
/// transform, and whether it is hidden.
fn walk(
    path: &Path,
    document: &GltfDocument,
    limits: &Limits,
    mut each: impl FnMut(usize, &GltfNode, Option<DMat4>, bool),
) -> Result<()> {
    let mut visited = vec![false; document.nodes.len()];
    let mut stack: Vec<(usize, Option<DMat4>, bool, u64)> =
        roots(path, document)?.into_iter().rev().map(|n| (n, None, false, 0)).collect();
    while let Some((index, parent, is_hidden, depth)) = stack.pop() {
        limits.nesting(format_args!("{}: node {index}", path.display()), depth)?;
        let place = || format!("node {index}");
        let node = entry(path, "node", &document.nodes, index)?;
        if std::mem::replace(&mut visited[index], true) {
            return Err(Error::malformed(path, place(), "has two parents or is its own ancestor"));
        }
        let transform = match (parent, local(node)) {
            (Some(parent), Some(local)) => Some(parent * local),
            (parent, local) => parent.or(local),
        };
        if transform.is_some_and(|t| !t.is_finite()) {
            return Err(Error::malformed(path, place(), "has a transform that is not finite"));
        }
        let is_hidden = is_hidden || node.is_hidden();
        each(index, node, transform, is_hidden);
        let children = node.children.iter().rev();
        stack.extend(children.map(|&child| (child, transform, is_hidden, depth + 1)));
    }
    Ok(())
}

/// Endings of names of nodes whose meshes Godot's importer uses only for collisions.
const COLLIDERS: [&str; 2] = ["-colonly", "-convcolonly"];

/// Root nodes: of the default scene, or all without a parent.
fn roots(path: &Path, document: &GltfDocument) -> Result<Vec<usize>> {
    let scene = match document.scene {
        Some(index) => Some(entry(path, "scene", &document.scenes, index)?),
        None => document.scenes.first(),
    };
    if let Some(scene) = scene {
        return Ok(scene.nodes.clone());
    }
    let mut is_child = vec![false; document.nodes.len()];
    for child in document.nodes.iter().flat_map(|node| &node.children) {
        if let Some(flag) = is_child.get_mut(*child) {
            *flag = true;
        }
    }
    Ok((0..is_child.len()).filter(|&node| !is_child[node]).collect())
}

/// A node's own transform; none when it is the identity, so that positions keep their bits.
fn local(node: &GltfNode) -> Option<DMat4> {
    let transform = match node.matrix {
        Some(columns) => {
            let rounded = DMat4::from_cols_array(&columns.map(|x| f64::from(x as f32)));
            let moved = translation([columns[12], columns[13], columns[14]]);
            DMat4 { w_axis: moved.extend(rounded.w_axis.w), ..rounded }
        }
        None => {
            let to_f64 = |v: [f32; 3]| Vec3::from(v).as_dvec3();
            let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]).map(f64::from);
            let rotation = DQuat::from_xyzw(x, y, z, w);
            // Four f32 numbers are a unit quaternion only nearly.
            let rotation = if rotation.length_squared() > 0.0 {
                rotation.normalize()
            } else {
                DQuat::IDENTITY
            };
            DMat4::from_scale_rotation_translation(
                node.scale.map_or(DVec3::ONE, to_f64),
                rotation,
                node.translation.map_or(DVec3::ZERO, translation),
            )
        }
    };
    (transform != DMat4::IDENTITY).then_some(transform)
}

/// A translation in single precision, as in engines; far from the origin in double precision.
fn translation(written: [f64; 3]) -> DVec3 {
    let written = DVec3::from(written);
    let rounded = written.as_vec3();
    if rounded.is_finite() && is_far(written) { written } else { rounded.as_dvec3() }
}

/// Moves all nodes so that `origin` becomes (0, 0, 0).
pub(crate) fn subtract_origin(instances: &mut [MeshInstance], origin: DVec3) {
    if origin == DVec3::ZERO {
        return;
    }
    for instance in instances {
        let placed = instance.transform.unwrap_or(DMat4::IDENTITY);
        instance.transform = Some(DMat4::from_translation(-origin) * placed);
    }
}

// ---- The glTF extensions read and written -------------------------------------------------------

/// The material shows its colour without lights.
pub(crate) const UNLIT: &str = "KHR_materials_unlit";
/// Integer positions.
pub(crate) const QUANTIZATION: &str = "KHR_mesh_quantization";
/// Compressed primitives, which are not read.
pub(crate) const DRACO: &str = "KHR_draco_mesh_compression";
/// Many copies of a node's mesh.
pub(crate) const INSTANCING: &str = "EXT_mesh_gpu_instancing";

/// Extensions that a file may require: they are read, or only change the look of a surface.
const READABLE: [&str; 13] = [
    format::GLTF_EXTENSION,
    format::SPZ_EXTENSION,
    QUANTIZATION,
    MESHOPT,
    MESHOPT_KHR,
    "KHR_texture_transform",
    "KHR_node_visibility",
    // Its pictures are named in a warning.
    "KHR_texture_basisu",
    INSTANCING,
    "EXT_texture_webp",
    "EXT_texture_avif",
    "KHR_lights_punctual",
    // Refused at its use, with a remedy.
    DRACO,
];

/// True when a file that requires this extension can be read.
pub(crate) fn is_readable(name: &str) -> bool {
    READABLE.contains(&name) || name.starts_with("KHR_materials_")
}

// ---- Limits on sizes and counts of files, shared by reading and writing -------------------------

const GIB: u64 = 1 << 30;

/// Files above this size are written with a warning.
pub(crate) const WARN_BYTES: u64 = GIB;
/// The largest signed 32-bit number: Unity's glTFast, JavaScript buffers and older Godot stop here.
pub(crate) const READABLE_BYTES: u64 = i32::MAX as u64;
/// GLB lengths are unsigned 32-bit numbers.
pub(crate) const GLB_BYTES: u64 = u32::MAX as u64;
/// Chunks of a GLB; glTF 2.0 knows two, and a file of empty chunks has one every 8 bytes.
pub(crate) const MAX_GLB_CHUNKS: usize = 64;
/// Permitted unpacked bytes for the smallest files.
pub(crate) const FREE_UNPACKED_BYTES: u64 = 16 << 20;
/// Maximum number of vertices for 16-bit indices: 65,535 itself means "restart" in many graphics
/// APIs.
pub(crate) const MAX_SHORT_VERTICES: u64 = u16::MAX as u64;
