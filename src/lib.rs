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
//! let scene = trisplat::read("scene.ply")?;
//! let baked = trisplat::bake(scene, &trisplat::BakeOptions::default())?;
//! baked.write("scene.glb")?;
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! From photos with poses: [`Dataset::load`], then [`train()`], then [`BakeJob`] with the photos. The folder `examples` has whole
//! programs. Everything else is in the crates of the workspace, one per room: `trisplat-raster`, `trisplat-formats` and so on. The command line and its progress bars are behind the feature `cli`, training and drawing on a graphics card behind
//! `gpu`, the window behind `view`; only `cli` is on unless `default-features = false`.

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
#[cfg(feature = "web")]
#[doc(hidden)]
pub mod web;

pub use trisplat_bake::TextureWhen;
pub use trisplat_bake::{BakeOptions, BakePreset, Views};
pub use trisplat_bake::{MeshOptions, mesh};
pub use trisplat_dataset::{Dataset, DatasetOptions};
pub use trisplat_formats::{OutputOptions, ReadOptions};
pub use trisplat_job::{
    BakeDone, BakeInput, BakeJob, Baked, Draw, EvalJob, Event, MakeJob, MeshJob, Observer, RenderJob,
    TrainDone, TrainJob, TrainPart, bake, draw, read, score, train,
};
pub use trisplat_scene::Asset;
pub use trisplat_scene::Limits;
pub use trisplat_scene::Soup;
pub use trisplat_scene::camera::Camera;
pub use trisplat_scene::image::RgbImage;
pub use trisplat_scene::mesh::Mesh;
pub use trisplat_scene::report::{Report, StageEvent};
pub use trisplat_scene::{Error, Result};
pub use trisplat_scene::{ImportedScene, Scene};
pub use trisplat_train::{TrainEvent, TrainOptions, TrainPreset, TrainSample, Trained};
