//! trisplat turns posed photographs into triangle scenes that a game engine can draw directly.
//!
//! ```text
//!  photos + poses                                                  scene.glb / .gltf / .obj / .ply
//!        │                                                                  ▲
//!    dataset ──► train ──► Soup ──► bake ──► Asset ──────────────────────► formats
//!                            ▲               prune solid color unseen refit weld …
//!                         formats (ply, pt, off, obj, gltf)
//! ```
//!
//! A **Soup** is the trained scene: unconnected triangles with opacity, smoothness σ and spherical-harmonic
//! colour. A **Mesh** is in an engine's form. An **Asset** is a mesh with its chunks, BVH and provenance. The
//! maths follow Held et al. 2025, *Triangle Splatting for Real-Time Radiance Field Rendering*.
//!
//! From a file, as `trisplat bake scene.ply -o scene.glb` does:
//!
//! ```no_run
//! use std::path::Path;
//! use trisplat::{BakeOptions, ReadOptions, bake, read, write};
//!
//! let (scene, options) = (read(Path::new("scene.ply"), &ReadOptions::default())?, BakeOptions::default());
//! let asset = bake(scene, &options)?;
//! write(&asset, Path::new("scene.glb"), &options.output)?;
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! From memory to memory:
//!
//! ```
//! use glam::Vec3;
//! use trisplat::formats::gltf::{GltfOptions, to_glb_bytes};
//! use trisplat::{BakeOptions, Soup, bake};
//!
//! let soup = Soup {
//!     vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]],
//!     opacity: vec![1.0],
//!     sigma: vec![0.01],           // nearly solid
//!     sh: vec![[0.5, 0.0, -0.5]],  // one SH coefficient: the same colour from everywhere
//!     sh_degree: 0,
//!     ..Soup::default()
//! };
//! let asset = bake(soup, &BakeOptions::default())?;
//! let glb: Vec<u8> = to_glb_bytes(&asset, &GltfOptions::default())?;
//! assert!(glb.starts_with(b"glTF"));
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! From photos with poses: [`Dataset::load`], then [`train()`], then [`Bake`] with the photos. The folder `examples` has whole
//! programs. The command line and its progress bars are behind the feature `cli`, training and drawing on a graphics card behind
//! `gpu`, the window behind `view`, the benchmarks behind `bench`; only `cli` is on unless `default-features = false`.

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
#[cfg(feature = "web")]
#[doc(hidden)]
pub mod web;

pub use trisplat_bake::{Bake, BakeOptions, BakePreset, Views, bake};
pub use trisplat_dataset::{Dataset, DatasetOptions};
pub use trisplat_formats::{OutputOptions, ReadOptions, read, write};
pub use trisplat_job::{BakeJob, EvalJob, MakeJob, RenderJob, TrainJob, train};
pub use trisplat_scene::asset::Asset;
pub use trisplat_scene::camera::Camera;
pub use trisplat_scene::error::{Error, Result};
pub use trisplat_scene::limits::Limits;
pub use trisplat_scene::mesh::Mesh;
pub use trisplat_scene::report::Report;
pub use trisplat_scene::scene::{Loaded, Scene};
pub use trisplat_scene::soup::Soup;
pub use trisplat_train::{TrainOptions, TrainPreset, TrainRun, Trained};
