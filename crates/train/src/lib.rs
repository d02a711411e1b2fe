//! Photos to soup: the optimisation of Held et al. 2025.
//!
//! ```text
//! init ──► state ──► [ backend.step(photo, rates) … ] ──► densify ──► … ──► soup
//!                        schedule: rates, sizes, SH      visibility: complete passes
//! ```
//!
//! [`TrainInputs`] is one run, with its checkpoints, previews and curve; the crate `trisplat-job`
//! decides the options of a run.
//!
//! Sources, as the docs of this folder name them:
//! * *the paper*: Held et al. 2025, *Triangle Splatting for Real-Time Radiance Field Rendering*;
//!   *supplement*: its supplementary material.
//! * *TS*: the paper's code, `train.py`, `train_game_engine.py` and `arguments/__init__.py`.
//! * *TS+*: Held et al. 2025, *Triangle Splatting+: Differentiable Rendering with Opaque
//!   Triangles*, and its code.
//! * *3DGS*: Kerbl et al. 2023, *3D Gaussian Splatting for Real-Time Radiance Field Rendering*, and
//!   its code.
//!
//! In: posed photos, or pictures of a scene. Out: a soup, checkpoints, curves.

mod backend;
pub mod budget;
pub mod checkpoint;
mod cpu;
mod densify;
mod device;
mod eval;
mod exposure;
mod find;
#[cfg(feature = "gpu")]
mod gpu;
mod grow;
mod identity;
mod init;
mod known;
mod options;
mod outputs;
mod params;
mod pyramid;
mod relocate;
mod run;
mod schedule;
mod shell;
mod start;
mod timeline;
mod trained;
mod training;
mod update;
mod visibility;

pub use backend::{BackendVisibility, PhotoId, StepPhoto, StepStats, TrainBackend};
pub use checkpoint::Checkpoint;
pub use cpu::CpuBackend;
pub use densify::Densified;
pub use device::{BackendKind, BackendOptions};
pub use eval::{EvalScene, PhotoScore, Quality, SOLID_SAMPLES, TrainSample};
pub use exposure::solve_exposures;
pub use find::reconstruct_points;
#[cfg(feature = "gpu")]
pub use gpu::{CardScene, GpuBackend, GpuLimits};
pub use identity::{PhotoIdentity, RunIdentity};
pub use options::{
    DensifyOptions, InitOptions, REFERENCE_STEPS, SampleWeight, TrainOptions, TrainPreset,
};
pub use outputs::{TrainEvent, TrainObserver};
pub use params::{Anneal, Core, OptimizerState, Params};
pub use run::measure_speed;
pub use schedule::{Schedule, StepParams};
pub use shell::shell_around;
pub use start::{PREVIEW_PREFIX, Preview, TrainInputs, TrainOutputs, TrainedPart};
pub use trained::{TrainDetails, Trained};
pub use training::Training;
pub use trisplat_dataset::exposure::ExposureDetails;
