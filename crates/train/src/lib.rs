//! Photos to soup: the optimisation of Held et al. 2025.
//!
//! ```text
//! init ──► state ──► [ backend.step(photo, rates) … ] ──► refine ──► … ──► soup
//!                        schedule: rates, sizes, SH      visibility: complete passes
//! ```
//!
//! [`TrainRun`] is one run, with its checkpoints, previews and curve; the crate `trisplat-job` decides the options of a run.
//!
//! Sources, as the docs of this folder name them:
//! * *the paper*: Held et al. 2025, *Triangle Splatting for Real-Time Radiance Field Rendering*; *supplement*: its
//!   supplementary material.
//! * *TS*: the paper's code, `train.py`, `train_game_engine.py` and `arguments/__init__.py`.
//! * *TS+*: Held et al. 2025, *Triangle Splatting+: Differentiable Rendering with Opaque Triangles*, and its code.
//! * *3DGS*: Kerbl et al. 2023, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, and its code.
//!
//! In: posed photos, or pictures of a scene. Out: a soup, checkpoints, curves.

pub mod backend;
pub mod budget;
pub mod checkpoint;
pub mod core;
pub mod cpu;
pub mod device;
pub mod eval;
mod frame_loss;
mod from_scene;
#[cfg(feature = "gpu")]
pub mod gpu;
mod hardening;
pub mod identity;
pub mod init;
pub mod light;
pub mod neighbours;
pub mod options;
pub mod outputs;
pub mod params;
pub mod prepared_run;
mod presets;
pub mod progress;
pub mod pyramid;
pub mod refine;
mod relocate;
pub mod rotation;
pub mod run;
pub mod schedule;
mod shell;
pub mod skipped;
pub mod start;
pub mod timeline;
pub mod trained;
pub mod trainer;
pub mod update;
pub mod visibility;

pub use backend::TrainBackend;
pub use checkpoint::Checkpoint;
pub use core::Core;
pub use device::{BackendKind, BackendOptions};
pub use identity::RunIdentity;
pub use options::{PoseUse, TrainOptions, TrainPreset};
pub use outputs::{PREVIEW, Preview, RunOptions};
pub use progress::{TrainObserver, TrainSample};
pub use run::TrainRun;
pub use skipped::SkippedWork;
pub use start::Part;
pub use trained::{HardenedGain, TrainDetails, Trained};
pub use trainer::Trainer;

pub use trisplat_scene::work::WorkCount;
