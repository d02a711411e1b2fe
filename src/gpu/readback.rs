//! Reads textures and buffers back into main memory.

use super::device::Gpu;
use crate::error::{Error, Result};
use bytemuck::{AnyBitPattern, NoUninit};
use wgpu::{Buffer, BufferDescriptor, BufferUsages, Extent3d, MapMode, TexelCopyBufferInfo};
use wgpu::{TexelCopyBufferLayout, Texture};

/// The texels of a texture of four bytes per texel, rows from the top. `[H * W]`
pub fn texels(gpu: &Gpu, texture: &Texture) -> Result<Vec<[u8; 4]>> {
    let Extent3d { width, height, .. } = texture.size();
    let pitch = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let size = u64::from(pitch) * u64::from(height);
    let buffer = gpu.device.create_buffer(&BufferDescriptor {
        label: Some("readback"),
        size,
        usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let layout = TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pitch), rows_per_image: None };
    let to = TexelCopyBufferInfo { buffer: &buffer, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    gpu.queue.submit([encoder.finish()]);
    let bytes = bytes(gpu, &buffer)?;
    let row = |y: usize| &bytes[y * pitch as usize..][..4 * width as usize];
    Ok((0..height as usize)
        .flat_map(|y| bytemuck::cast_slice::<u8, [u8; 4]>(row(y)).iter().copied())
        .collect())
}

/// The first `count` elements of a buffer that can be copied from, when all work is done.
pub fn elements<T: AnyBitPattern + NoUninit>(gpu: &Gpu, buffer: &Buffer, count: usize) -> Result<Vec<T>> {
    let size = (count * size_of::<T>()) as u64;
    if size == 0 {
        return Ok(Vec::new());
    }
    let staging = gpu.device.create_buffer(&BufferDescriptor {
        label: Some("readback"),
        size: size.next_multiple_of(4),
        usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
        mapped_at_creation: false,
    });
    gpu.check()?;
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    encoder.copy_buffer_to_buffer(buffer, 0, &staging, 0, size);
    gpu.queue.submit([encoder.finish()]);
    Ok(bytemuck::pod_collect_to_vec(&bytes(gpu, &staging)?[..size as usize]))
}

/// The contents of a mappable buffer when all work is done.
fn bytes(gpu: &Gpu, buffer: &Buffer) -> Result<Vec<u8>> {
    let (sender, receiver) = std::sync::mpsc::channel();
    buffer.slice(..).map_async(MapMode::Read, move |result| {
        // The receiver is gone when the wait below has failed.
        let _ = sender.send(result);
    });
    gpu.wait(None)?;
    let lost = |e: &dyn std::fmt::Display| Error::Gpu(format!("{}: cannot read back: {e}", gpu.info.name));
    receiver.recv().map_err(|e| lost(&e))?.map_err(|e| lost(&e))?;
    let view = buffer.slice(..).get_mapped_range().map_err(|e| lost(&e))?;
    Ok(view.to_vec())
}
