//! glTF 2.0 and GLB, read back: our own files in all their variants, and others' with vertex colours.
//!
//! ```text
//! container (JSON + binary chunk) ──► document ──► nodes (which mesh stands where)
//!                  │                                  │
//!               buffers ──► accessor ◄── meshopt      │
//!                              └──────► merge ◄───────┘  ──► Mesh
//! ```
//!
//! The document is taken as hostile: every number is checked where it is followed, nothing is allocated
//! before the bytes behind it are known to be there, and no file unpacks to more than 1024 times its size.

pub(crate) mod accessor;
pub(crate) mod buffers;
pub(crate) mod container;
pub(crate) mod document;
mod merge;
mod meshopt;
mod nodes;

use super::{ReadOptions, Source, finish};
use crate::asset::{Provenance, UpAxis};
use crate::error::{Error, Result};
use crate::scene::{Loaded, Scene};
use accessor::Accessors;
use buffers::Buffers;
use container::Container;
use document::{AssetInfo, Document};
use merge::Merge;
use std::path::Path;

/// Extensions that may be required: those we read, and those that change only how a surface looks.
const KNOWN: [&str; 9] = [
    "KHR_mesh_quantization",
    "EXT_meshopt_compression",
    "KHR_meshopt_compression",
    "KHR_texture_transform",
    "KHR_texture_basisu",
    "EXT_texture_webp",
    "EXT_texture_avif",
    "KHR_lights_punctual",
    // Refused where it is used, with a remedy.
    "KHR_draco_mesh_compression",
];

/// The triangles of the default scene as one mesh: all nodes placed, all primitives merged, colours
/// linear.
///
/// Colours are one a face when no faces share vertices and each has one colour, so that our own files
/// come back as they were.
///
/// # Errors
/// `Malformed` for broken containers, JSON and accessors; `Unsupported` for glTF 1.0, Draco, unknown
/// required extensions and scenes without triangles.
pub fn read(mut source: Source, _options: &ReadOptions) -> Result<Loaded> {
    let path = source.path.clone();
    let container = Container::read(&mut source)?;
    let document: Document = document::parse(&path, &container.json)?;
    check_support(&path, &document)?;
    let instances = nodes::instances(&path, &document)?;
    let buffers = Buffers::new(source, &container, &document.buffers);
    drop(container);
    let mut merge = Merge::new(&document, Accessors::new(&document, buffers), document.asset.is_srgb());
    for node in &document.nodes {
        if node.skin.is_some() {
            merge.warn("skins are not applied");
        }
        if node.extensions.contains_key("EXT_mesh_gpu_instancing") {
            merge.warn("EXT_mesh_gpu_instancing is not read: its meshes are drawn once");
        }
    }
    merge.reserve(&instances)?;
    for instance in &instances {
        merge.add(instance)?;
    }
    let (mesh, warnings) = merge.finish()?;
    finish(
        &path,
        Loaded {
            scene: Scene::Mesh(mesh),
            provenance: document.asset.provenance(),
            warnings,
            cameras: Vec::new(),
        },
    )
}

fn check_support(path: &Path, document: &Document) -> Result<()> {
    if !document.asset.version.starts_with("2.") {
        return Err(Error::unsupported(
            path,
            format!("is glTF {:?}; convert it to glTF 2.0", document.asset.version),
        ));
    }
    let unknown = document
        .extensions_required
        .iter()
        .find(|name| !KNOWN.contains(&name.as_str()) && !name.starts_with("KHR_materials_"));
    match unknown {
        Some(name) => {
            Err(Error::unsupported(path, format!("requires the extension {name}; export it again without")))
        }
        None => Ok(()),
    }
}

impl AssetInfo {
    /// True when we wrote the file.
    fn is_ours(&self) -> bool {
        self.generator.as_deref().is_some_and(|generator| generator.starts_with("trisplat"))
    }

    /// True when our own note says that COLOR_0 is sRGB-encoded.
    fn is_srgb(&self) -> bool {
        let encoding = self.extras.as_ref().and_then(|extras| extras.get("color_encoding")?.as_str());
        self.is_ours() && encoding.is_some_and(|encoding| encoding.ends_with("-srgb"))
    }

    /// What the file says of its origin. glTF is Y up.
    pub(crate) fn provenance(&self) -> Provenance {
        let ours = self.extras.as_ref().filter(|_| self.is_ours());
        let mut provenance: Provenance =
            ours.and_then(|extras| serde_json::from_value(extras.clone()).ok()).unwrap_or_default();
        provenance.generator = provenance.generator.or_else(|| self.generator.clone());
        provenance.up = Some(UpAxis::Y);
        provenance
    }
}
