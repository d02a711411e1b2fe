//! trisplat turns posed photographs into triangle scenes a game engine can draw as they are.
//!
//! ```text
//!  photos + poses                                                  scene.glb / .gltf / .obj / .ply
//!        │                                                                  ▲
//!    dataset ──► train ──► Soup ──► bake ──► Asset ──────────────────────► formats
//!                            ▲               prune solid color unseen refit weld …
//!                         formats (ply, pt, off, obj, gltf)
//! ```
//!
//! A **Soup** is the trained scene: unconnected triangles with opacity, smoothness σ and
//! spherical-harmonic colour. A **Mesh** is what an engine draws. An **Asset** is a mesh with its
//! chunks, BVH and provenance. The maths follow Held et al. 2025, *Triangle Splatting for Real-Time
//! Radiance Field Rendering*.
//!
//! ```
//! use glam::Vec3;
//! use trisplat::bake::{BakeOptions, bake};
//! use trisplat::soup::Soup;
//!
//! let soup = Soup {
//!     vertices: vec![[Vec3::ZERO, Vec3::X, Vec3::Y]],
//!     opacity: vec![1.0],
//!     sigma: vec![0.01],           // nearly solid
//!     sh: vec![[0.5, 0.0, -0.5]],  // one SH coefficient: the same colour from everywhere
//!     sh_degree: 0,
//! };
//! let asset = bake(soup, &BakeOptions::default())?;
//! assert_eq!(asset.mesh.face_count(), 1);
//! # Ok::<(), trisplat::error::Error>(())
//! ```

pub mod asset;
pub mod atomic;
pub mod bake;
pub mod bench;
pub mod bvh;
pub mod camera;
#[cfg(feature = "cli")]
pub mod cli;
pub mod dataset;
pub mod error;
pub mod formats;
#[cfg(feature = "gpu")]
pub mod gpu;
pub mod image;
pub mod kernel;
pub mod math;
pub mod mesh;
pub mod placed;
pub mod process;
pub mod raster;
pub mod report;
pub mod rng;
pub mod scene;
pub mod soup;
pub mod train;
pub mod view;
