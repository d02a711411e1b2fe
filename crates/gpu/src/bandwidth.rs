//! Measures the memory bandwidth of the graphics card.

use super::device::Gpu;
use super::storage::storage;
use std::time::Instant;
use trisplat_scene::Result;
use wgpu::Buffer;

/// Bytes of the two buffers, if the card can bind as much.
const BYTES: u64 = 256 << 20;
/// Copies that are timed together.
const COPIES: u32 = 32;

/// Bytes per second of reading and writing together during a copy between two buffers: the practical
/// bandwidth.
///
/// Errors: no memory for two large buffers.
pub fn copy_bandwidth(gpu: &Gpu) -> Result<f64> {
    let limits = gpu.device.limits();
    let most = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
    // Software renderers copy smaller buffers equally fast, without waiting for seconds.
    let bytes = if gpu.is_software() { BYTES / 8 } else { BYTES }.min(most / 16 * 16);
    let buffer = || storage(gpu, "copies", bytes, "close other programs that use the card");
    let buffers: [Buffer; 2] = [buffer()?, buffer()?];
    let copy = |count: u32| {
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        for at in 0..count as usize {
            encoder.copy_buffer_to_buffer(&buffers[at % 2], 0, &buffers[1 - at % 2], 0, bytes);
        }
        let submission = gpu.queue.submit([encoder.finish()]);
        gpu.wait(Some(submission))
    };
    copy(2)?;
    let clock = Instant::now();
    copy(COPIES)?;
    Ok(2.0 * bytes as f64 * f64::from(COPIES) / clock.elapsed().as_secs_f64())
}
