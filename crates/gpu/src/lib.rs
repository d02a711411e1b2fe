//! The graphics card: finding one, filling its buffers, compute kernels, reading back. Does not
//! depend on mesh types.
//!
//! In: nothing. Out: an open card, its buffers and kernels.

pub mod buffer;
mod compute;
mod device;
pub mod readback;

pub use buffer::{storage, uniform};
pub use compute::{Kernel, workgroups};
pub use device::{AdapterOptions, Gpu, GraphicsApi};
/// The graphics interface, for those who hold a [`Gpu`].
pub use wgpu;
