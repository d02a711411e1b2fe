//! Buffers: filled in parallel, or for kernels, within the limits of the card.

use super::device::Gpu;
use bytemuck::NoUninit;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Error, Result};
use wgpu::{Buffer, BufferDescriptor, BufferUsages};

/// Elements that are computed before they are copied.
const BATCH: usize = 1 << 20;

/// A buffer of `count` elements, element i being `element(i)`. An empty one has space for one.
///
/// # Errors
///
/// More bytes than the card allows in one buffer, or has left; `what` names the buffer in the
/// message.
pub fn filled<T: NoUninit + Send>(
    gpu: &Gpu,
    what: &str,
    usage: BufferUsages,
    count: usize,
    element: impl Fn(usize) -> T + Sync,
) -> Result<Buffer> {
    let width = size_of::<T>();
    let size = (count.max(1) * width) as u64;
    let limit = gpu.device.limits().max_buffer_size;
    if size > limit {
        let remedy = "bake fewer triangles (`max_triangles`), or choose another `adapter`".into();
        let what = format!("gpu: {what} for {}", gpu.info.name);
        return Err(Error::TooLarge { what, bytes: size, limit, remedy });
    }
    // The size of a buffer that is mapped at creation is a multiple of four.
    let buffer = gpu.device.create_buffer(&BufferDescriptor {
        label: Some(what),
        size: size.next_multiple_of(4),
        usage,
        mapped_at_creation: true,
    });
    gpu.check()?;
    let unmappable = |e| Error::Gpu(format!("{what} of {size} bytes: {e}"));
    let mut view = buffer.slice(..).get_mapped_range_mut().map_err(unmappable)?;
    for first in (0..count).step_by(BATCH) {
        let elements: Vec<T> =
            parallel::collect(BATCH.min(count - first), GRAIN, |at| element(first + at));
        let bytes: &[u8] = bytemuck::cast_slice(&elements);
        view.slice(first * width..first * width + bytes.len()).copy_from_slice(bytes);
    }
    drop(view);
    buffer.unmap();
    gpu.check()?;
    Ok(buffer)
}

/// A storage buffer of `bytes`, filled with zeros; an empty one holds one vector. It can be copied
/// to and from.
///
/// # Errors
///
/// More than the card binds at once, or has left; the message contains `what`, the name of the
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
