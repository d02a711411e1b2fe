//! The training scene on a graphics card: the second backend behind
//! [`TrainBackend`](super::TrainBackend).
//!
//! ```text
//! project → sort by depth → bin → sort by tile → forward → loss → backward → gather → update
//! ```
//! Each arrow is one or several compute passes, a WGSL file each in `passes`; shared functions come
//! from one source, and constants from their Rust twins. Nothing is summed by float atomics, so the
//! same seed gives the same bits on the same card. Parameters and moments stay on the card between
//! `load` and `store`.

mod gpu_backend;
mod limits;
mod passes;
mod picture;
mod scene;
mod sequence;
mod step_buffers;
mod step_passes;
mod uniform;

pub use gpu_backend::GpuBackend;
pub(super) use gpu_backend::expected_bytes;
pub use picture::CardScene;
pub use step_buffers::GpuLimits;
