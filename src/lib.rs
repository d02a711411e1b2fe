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

pub mod asset;
pub mod atomic;
pub mod bake;
#[cfg(feature = "bench")]
#[doc(hidden)]
pub mod bench;
pub mod budget;
pub mod bvh;
pub mod camera;
pub mod capture;
#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
pub mod dataset;
pub mod error;
pub mod eval;
pub mod exposure;
pub mod formats;
pub mod framing;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod guard;
pub mod image;
pub mod input;
pub mod job;
pub mod kernel;
pub mod layered;
pub mod limits;
pub mod math;
pub mod mesh;
pub mod placed;
#[doc(hidden)]
pub mod process;
pub mod ranges;
pub mod raster;
pub mod region;
pub mod render;
pub mod report;
pub mod rng;
pub mod sample;
pub mod scale;
pub mod scene;
pub mod soup;
pub mod space;
pub mod surface;
pub mod teacher;
pub mod texture;
pub mod train;
pub mod view;
#[cfg(feature = "web")]
#[doc(hidden)]
pub mod web;
mod work;

pub use asset::Asset;
pub use bake::{Bake, BakeOptions, BakePreset, Views, bake};
pub use camera::Camera;
pub use dataset::{Dataset, DatasetOptions};
pub use error::{Error, Result};
pub use formats::{OutputOptions, ReadOptions, read, write};
pub use job::{BakeJob, EvalJob, MakeJob, RenderJob, TrainJob, train};
pub use limits::Limits;
pub use mesh::Mesh;
pub use report::Report;
pub use scene::{Loaded, Scene};
pub use soup::Soup;
pub use train::{TrainOptions, TrainPreset, TrainRun, Trained};
