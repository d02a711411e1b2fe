//! The graphics card: finding one, filling its buffers, reading back, timing. Knows no triangle.

pub mod adapter;
pub mod buffer;
pub mod device;
pub mod readback;
pub mod timer;

pub use adapter::{AdapterOptions, Backend};
pub use device::Gpu;
