//! trisplat turns posed photographs into triangle scenes a game engine can draw as they are.
//!
//! ```text
//!  photos + poses                                                  scene.glb / .gltf / .obj / .ply
//!        │                                                                  ▲
//!    dataset ──► train ──► Soup ──► bake ──► Asset ──────────────────────► formats
//!                            ▲               prune solid color weld order chunk bvh
//!                         formats (ply, pt, off, obj, gltf)
//! ```
//!
//! A **Soup** is the trained scene: unconnected triangles with opacity, smoothness σ and
//! spherical-harmonic colour. A **Mesh** is what an engine draws. An **Asset** is a mesh with its
//! chunks, BVH and provenance. The maths follow Held et al. 2025, *Triangle Splatting for Real-Time
//! Radiance Field Rendering*.

pub mod asset;
pub mod bake;
pub mod bench;
pub mod bvh;
pub mod camera;
pub mod cli;
pub mod dataset;
pub mod error;
pub mod formats;
pub mod image;
pub mod kernel;
pub mod math;
pub mod mesh;
pub mod raster;
pub mod report;
pub mod rng;
pub mod scene;
pub mod soup;
pub mod train;
pub mod view;
