//! Storage buffers, within the limits of the card.

use super::device::Gpu;
use trisplat_scene::{Error, Result};
use wgpu::{Buffer, BufferDescriptor, BufferUsages};

/// A storage buffer of `bytes`, filled with zeros; an empty one holds one vector. It can be copied to and from.
///
/// Errors: more than the card binds at once, or has left; the message contains `what`, the name of the
/// buffer, and `remedy`.
pub fn storage(gpu: &Gpu, what: &str, bytes: u64, remedy: &str) -> Result<Buffer> {
    let limits = gpu.device.limits();
    let limit = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    let size = bytes.max(16).next_multiple_of(16);
    if size > limit {
        let what = format!("gpu: {what} for {}", gpu.info.name);
        return Err(Error::TooLarge { what, bytes, limit, remedy: remedy.to_owned() });
    }
    let buffer = gpu.device.create_buffer(&BufferDescriptor {
        label: Some(what),
        size,
        usage: BufferUsages::STORAGE
            | BufferUsages::COPY_DST
            | BufferUsages::COPY_SRC
            | BufferUsages::INDIRECT,
        mapped_at_creation: false,
    });
    gpu.check().map_err(|e| Error::Gpu(format!("{what} of {bytes} bytes: {e}; {remedy}")))?;
    Ok(buffer)
}

/// A uniform buffer of `bytes`.
pub fn uniform(gpu: &Gpu, what: &str, bytes: u64) -> Buffer {
    gpu.device.create_buffer(&BufferDescriptor {
        label: Some(what),
        size: bytes,
        usage: BufferUsages::UNIFORM | BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}
