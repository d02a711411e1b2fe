//! glTF 2.0 and GLB, written and read.
//!
//! In: assets. Out: bytes of glTF, byte for byte as engines want them. In: bytes of glTF. Out:
//! scenes.
//!
//! ```text
//! written: Asset ──► part (one mesh and node per chunk: bounds, grid, streams) ──► encode (the buffer) ──► compose (the JSON)
//!                                                                                     └──► write ◄──────────┘
//! read:    container ──► document, material (and which mesh is where)
//!              │                        │
//!           buffers ──► accessor ──► merge ──► read ──► Mesh
//! ```
//!
//! The writer writes unlit, opaque triangles, drawn from one side or from both, with a colour per
//! vertex or one texture. The reader reads these files in all variants, and files of other programs
//! with vertex colours or one picture. The document is composed of `gltf-json`'s types; the module
//! `document` explains why reading uses types of this crate.

mod accessor;
mod buffers;
mod check;
mod compose;
mod container;
mod document;
mod encode;
mod material;
mod merge;
mod meshopt;
mod options;
mod part;
mod read;
mod sh;
mod skin;
mod splats;
mod write;

pub(crate) use buffers::from_file_name;
pub use buffers::named_files;
pub use check::{Finding, Severity};
pub(crate) use check::{Findings, check};
pub use container::{Container, check_size, glb_size, stream_offsets};
pub(crate) use meshopt::MAX_UNPACK_RATIO;
pub use options::{ColorEncoding, GltfOptions, PositionEncoding, TextureFormat};
pub(crate) use part::node_names;
pub(crate) use read::gltf_info;
pub use read::{GltfInfo, read};
pub use sh::ShExtras;
pub use splats::{holds_splats, holds_splats_beside_mesh, read_splats};
pub use write::{WrittenGltf, to_glb_bytes, write_glb, write_gltf};
