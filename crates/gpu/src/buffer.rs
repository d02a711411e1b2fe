//! Buffers, filled in parallel.

use super::device::Gpu;
use bytemuck::NoUninit;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Error, Result};
use wgpu::{Buffer, BufferDescriptor, BufferUsages};

/// Elements that are computed before they are copied.
const BATCH: usize = 1 << 20;

/// A buffer of `count` elements, element i being `element(i)`. An empty one has space for one.
///
/// Errors: more bytes than the card allows in one buffer, or has left; `what` names the buffer in the
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
        let elements: Vec<T> = parallel::collect(BATCH.min(count - first), GRAIN, |at| element(first + at));
        let bytes: &[u8] = bytemuck::cast_slice(&elements);
        view.slice(first * width..first * width + bytes.len()).copy_from_slice(bytes);
    }
    drop(view);
    buffer.unmap();
    gpu.check()?;
    Ok(buffer)
}
