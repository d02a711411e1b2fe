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
//! # let linear_rgb = [[1.0, 0.5, 0.0], [0.0, 0.5, 1.0]];
//! let baked = trisplat::bake(Mesh::from_triangles(&triangles, &linear_rgb)?, &BakeOptions::default())?;
//! let bytes: Vec<u8> = baked.to_glb()?;
//! # assert_eq!(trisplat::read_bytes(&bytes, trisplat::Format::Glb)?.triangle_count(), 2);
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! Gaussian splats in memory:
//!
//! ```no_run
//! # use trisplat::{BakeOptions, Format};
//! let baked = trisplat::bake(trisplat::read_bytes(&std::fs::read("splats.spz")?, Format::Spz)?, &BakeOptions::fast())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Photos with poses become a scene, which [`Trained::save`] writes and [`bake()`] takes:
//!
//! ```no_run
//! # use std::ops::ControlFlow;
//! # use trisplat::{Dataset, DatasetOptions, TrainOptions};
//! let photos = Dataset::load("photos", &DatasetOptions::default())?;
//! let options = TrainOptions::default().steps(500).max_triangles(20_000).seed(1);
//! let trained = trisplat::train(&photos, &options, &mut |event| ControlFlow::Continue(()))?;
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! Scores on the photos that training did not see:
//!
//! ```no_run
//! # use trisplat::{BakeOptions, Dataset, DatasetOptions};
//! # let photos = Dataset::load("photos", &DatasetOptions::default())?;
//! # let baked = trisplat::bake(trisplat::read("scene.ply")?, &BakeOptions::fast())?;
//! let scores: trisplat::Scores = trisplat::score(&baked, &photos)?;
//! # Ok::<(), trisplat::Error>(())
//! ```
//!
//! Pictures of a scene, which is prepared once; rays; a copy in another format:
//!
//! ```standalone_crate
//! # use trisplat::{BakeOptions, Camera, Mesh, Renderer, glam::Vec3};
//! # let folder = tempfile::tempdir()?;
//! # std::env::set_current_dir(folder.path())?;
//! # let mesh = Mesh::from_triangles(&[[Vec3::NEG_X, Vec3::X, Vec3::Y]], &[[1.0, 0.5, 0.0]])?;
//! # trisplat::bake(mesh, &BakeOptions::default())?.write("mesh.glb")?;
//! let scene = trisplat::read("mesh.glb")?;
//! let renderer = Renderer::new(&scene)?;
//! for camera in Camera::orbit(&scene.bounds(), 12, 0.8, [640, 480]) {
//!     let picture = renderer.draw(&camera)?;
//! }
//! # let (origin, direction) = (scene.bounds().center() + 4.0 * Vec3::Z, Vec3::NEG_Z);
//! let hit: Option<trisplat::Hit> = scene.raycast(origin, direction);
//! trisplat::write(&scene, "copy.ply")?;
//! # assert!(hit.is_some() && trisplat::read("copy.ply")?.triangle_count() == scene.triangle_count());
//! # std::env::set_current_dir("/")?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`BakeJob`] bakes with photos, [`MakeJob`] goes from photos or a video to files. The folder
//! `examples` has whole programs; everything else is in the crates of the workspace. The command
//! line is behind the feature `cli`, a graphics card behind `gpu`, the window behind `view`; only
//! `cli` is on unless `default-features = false`.

#[cfg(feature = "cli")]
#[doc(hidden)]
pub mod cli;
#[cfg(feature = "web")]
#[doc(hidden)]
pub mod web;

pub use glam;
pub use trisplat_bake::{BakeOptions, BakePreset, MeshOptions, TextureWhen, Views, mesh};
pub use trisplat_dataset::capture::{Capture, CaptureOptions, VerdictDetails};
pub use trisplat_dataset::exposure::ExposureEvidence;
pub use trisplat_dataset::{Dataset, DatasetOptions, Split, View};
pub use trisplat_formats::gltf::GltfOptions;
pub use trisplat_formats::output::Output;
pub use trisplat_formats::{
    Content, Format, OutputOptions, OutputTarget as Target, ReadOptions, WrittenFiles,
};
pub use trisplat_job::{
    AnyScene, BakeInput, BakeJob, Baked, CoverageScores, DepthScores, EvalJob, EvalReport, Event,
    ImageScore, MakeDone, MakeJob, MakePart, MeshJob, Observer, PictureKind, ReadyEval,
    ReadyRender, RenderJob, RenderMode, RenderOptions, Renderer, RepresentationScore,
    ScoredPicture, Scores, ShineScores, TeacherPlan, TeacherSource, TrainBegins, TrainJob,
    TrainPart, TrainResult, bake, read, read_bytes, score, train, write,
};
pub use trisplat_scene::atomic::StartedFiles;
pub use trisplat_scene::camera::{Camera, Viewpoint};
pub use trisplat_scene::image::RgbImage;
pub use trisplat_scene::layered::Layered;
pub use trisplat_scene::mesh::{Colors, Mesh};
pub use trisplat_scene::report::{Counts, OutputReport, Report, StageReport};
pub use trisplat_scene::{
    Asset, Bounds, Budget, Error, Hit, ImportedScene, ImportedSplats, Limits, Provenance, Result,
    Scene, Seconds, Soup, Splats,
};
pub use trisplat_train::budget::Correction;
pub use trisplat_train::{
    BackendOptions, Checkpoint, Densified, TrainOptions, TrainOutputs, TrainPreset, TrainSample,
    Trained,
};
