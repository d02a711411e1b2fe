//! The graphics card: finding one, filling its buffers, compute kernels, reading back, timing. Does not depend on mesh types.
//!
//! In: nothing. Out: an open card, its buffers, kernels and timers.

pub mod buffer;
mod compute;
mod device;
pub mod readback;
mod timer;

pub use buffer::{storage, uniform};
pub use compute::{Kernel, workgroups};
pub use device::{AdapterOptions, Gpu, GraphicsApi};
pub use timer::Timer;
/// The graphics interface, for those who hold a [`Gpu`].
pub use wgpu;
