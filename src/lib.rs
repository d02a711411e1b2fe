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
//! A **Soup** is the trained scene: unconnected triangles with opacity, smoothness σ and
//! spherical-harmonic colour. A **Mesh** is in an engine's form. An **Asset** is a mesh with its
//! chunks and provenance. The maths follow Held et al. 2025, *Triangle Splatting for Real-Time
//! Radiance Field Rendering*.
//!
//! A file for an engine, as `trisplat bake scene.ply -o scene.glb` makes it:
//!
//! ```no_run
//! # use trisplat::{BakeOptions, Target};
//! let baked = trisplat::bake(trisplat::read("scene.ply")?, &BakeOptions::fast().target(Target::Godot).max_triangles(4000))?;
//! baked.write("scene.glb")?;
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! Triangles of your own, with nothing on disk:
//!
//! ```
//! # use trisplat::{BakeOptions, Mesh, glam::Vec3};
//! # let triangles = [[Vec3::ZERO, Vec3::X, Vec3::Y], [Vec3::X, Vec3::ONE, Vec3::Y]];
//! # let colors = [[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]];
//! let asset = trisplat::bake(Mesh::from_triangles(&triangles, &colors)?, &BakeOptions::default())?;
//! let bytes: Vec<u8> = asset.to_glb()?;
//! # assert_eq!(trisplat::read_bytes(&bytes, trisplat::Format::Glb)?.scene.triangle_count(), 2);
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! Photos with poses become a scene, which [`Trained::save`] writes and [`bake()`] takes:
//!
//! ```no_run
//! # use std::ops::ControlFlow;
//! # use trisplat::{Dataset, DatasetOptions, TrainOptions};
//! let photos = Dataset::load("photos", &DatasetOptions::default())?;
//! let trained = trisplat::train(&photos, &TrainOptions::default().steps(500), &mut |event| ControlFlow::Continue(()))?;
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! Pictures of a scene, which is prepared once:
//!
//! ```
//! # use trisplat::{Camera, Mesh, Renderer, glam::Vec3};
//! # let scene = Mesh::from_triangles(&[[Vec3::NEG_X, Vec3::X, Vec3::Y]], &[[1.0, 0.5, 0.0]])?.into();
//! # let (target, fov_y, angles) = (Vec3::ZERO, 0.8, [0.0f32, 1.0]);
//! let renderer = Renderer::new(&scene)?;
//! for angle in angles {
//!     let eye = Vec3::new(angle.sin(), 0.5, angle.cos()) * 4.0;
//!     let picture = renderer.draw(&Camera::look_at(eye, target, Vec3::Y, fov_y, [640, 480]))?;
//!     # assert!(picture.rgb.iter().any(|pixel| *pixel != [0; 3]));
//! }
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! What a ray hits first:
//!
//! ```
//! # use trisplat::{BakeOptions, Mesh, glam::Vec3};
//! # let mesh = Mesh::from_triangles(&[[Vec3::NEG_X, Vec3::X, Vec3::Y]], &[[1.0, 0.5, 0.0]])?;
//! # let asset = trisplat::bake(mesh, &BakeOptions::fast())?;
//! # let (origin, direction) = (Vec3::new(0.0, 0.5, 4.0), Vec3::NEG_Z);
//! if let Some(hit) = asset.raycast(origin, direction) {
//!     println!("{} at {}", hit.face, hit.distance);
//! }
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! [`BakeJob`] bakes with photos. The folder `examples` has whole programs; everything else is in
//! the crates of the workspace. The command line is behind the feature `cli`, a graphics card
//! behind `gpu`, the window behind `view`; only `cli` is on unless `default-features = false`.

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
#[cfg(feature = "web")]
#[doc(hidden)]
pub mod web;

pub use glam;
pub use trisplat_bake::{BakeOptions, BakePreset, MeshOptions, TextureWhen, Views, mesh};
pub use trisplat_dataset::{Dataset, DatasetOptions};
pub use trisplat_formats::gltf::GltfOptions;
pub use trisplat_formats::{
    Format, OutputOptions, OutputTarget as Target, ReadOptions, WrittenFiles,
};
pub use trisplat_job::{
    BakeDone, BakeInput, BakeJob, Baked, EvalJob, Event, MakeJob, MeshJob, Observer, RenderJob,
    Renderer, TrainDone, TrainJob, TrainPart, bake, read, read_bytes, score, train,
};
pub use trisplat_scene::camera::Camera;
pub use trisplat_scene::image::RgbImage;
pub use trisplat_scene::mesh::{Colors, Mesh};
pub use trisplat_scene::report::{Report, StageEvent};
pub use trisplat_scene::{
    Asset, Budget, Error, ImportedScene, Limits, Result, Scene, Seconds, Soup, Splats,
};
pub use trisplat_train::{TrainEvent, TrainOptions, TrainPreset, TrainSample, Trained};
