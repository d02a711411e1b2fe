//! The graphics card: finding one, filling its buffers, compute kernels, reading back, timing. Does not depend on mesh types.
//!
//! In: nothing. Out: an open card, its buffers, kernels and timers.

mod adapter;
mod bandwidth;
pub mod buffer;
mod compute;
mod device;
pub mod readback;
mod stages;
mod storage;
mod timer;

pub use adapter::{AdapterOptions, GraphicsApi};
pub use bandwidth::copy_bandwidth;
pub use compute::{Kernel, workgroups};
pub use device::Gpu;
pub use stages::StageTimer;
pub use storage::{storage, uniform};
pub use timer::Timer;
/// The graphics interface, for those who hold a [`Gpu`].
pub use wgpu;
