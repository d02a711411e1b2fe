//! Photos to soup: the optimisation of Held et al. 2025.
//!
//! ```text
//! init ──► state ──► [ backend.step(photo, rates) … ] ──► densify ──► … ──► soup
//!                        schedule: rates, sizes, SH      visibility: complete passes
//! ```
//!
//! [`TrainInputs`] start a [`Training`], whose result is [`Trained`]; the crate `trisplat-job`
//! decides the options.
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
#[cfg(feature = "gpu")]
mod gpu;
mod identity;
mod init;
mod initial;
mod inputs;
mod options;
mod params;
mod pyramid;
mod recorder;
mod relocate;
mod schedule;
mod shell;
mod speed;
mod stereo;
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
#[cfg(feature = "gpu")]
pub use gpu::{CardScene, GpuBackend, GpuLimits};
pub use identity::{PhotoIdentity, RunIdentity};
pub use inputs::{PREVIEW_PREFIX, Preview, TrainInputs, TrainOutputs, TrainedPart};
pub use options::{
    DensifyOptions, InitOptions, REFERENCE_STEPS, SampleWeight, TrainOptions, TrainPreset,
};
pub use params::{Anneal, Core, OptimizerState, Params};
pub use recorder::{TrainEvent, TrainObserver};
pub use schedule::{Schedule, StepParams};
pub use shell::shell_around;
pub use speed::measure_speed;
pub use stereo::{DepthsDetails, measure_depths, reconstruct_points};
pub use trained::{TrainDetails, Trained};
pub use training::Training;
pub use trisplat_dataset::exposure::ExposureDetails;
