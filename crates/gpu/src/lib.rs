//! The graphics card: finding one, filling its buffers, compute kernels, reading back, timing. Does not depend on mesh types.
//!
//! In: nothing. Out: an open card, its buffers, kernels and timers.

pub mod adapter;
pub mod bandwidth;
pub mod buffer;
pub mod compute;
pub mod device;
pub mod readback;
pub mod stages;
pub mod storage;
pub mod timer;

pub use adapter::{AdapterOptions, GraphicsApi};
pub use device::Gpu;
/// The graphics interface, for those who hold a [`Gpu`].
pub use wgpu;
