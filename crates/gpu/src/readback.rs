//! Reads textures and buffers back into main memory.

use super::device::Gpu;
use bytemuck::{AnyBitPattern, NoUninit};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use trisplat_scene::{Error, Result};
use wgpu::{
    Buffer, BufferAsyncError, BufferDescriptor, BufferUsages, CommandEncoder, Extent3d, MapMode,
    PollType, SubmissionIndex, TexelCopyBufferInfo, TexelCopyBufferLayout, Texture,
};

/// The texels of a texture of four bytes per texel, rows from the top. `[H * W]`
pub fn texels(gpu: &Gpu, texture: &Texture) -> Result<Vec<[u8; 4]>> {
    let Extent3d { width, height, .. } = texture.size();
    let pitch = (4 * width).next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
    let size = u64::from(pitch) * u64::from(height);
    let mut readback = Readback::new(gpu, size);
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let layout =
        TexelCopyBufferLayout { offset: 0, bytes_per_row: Some(pitch), rows_per_image: None };
    let to = TexelCopyBufferInfo { buffer: &readback.staging, layout };
    encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    readback.submitted(gpu.queue.submit([encoder.finish()]));
    let bytes: Vec<u8> = readback.take(gpu, true)?.unwrap_or_default();
    let row = |y: usize| &bytes[y * pitch as usize..][..4 * width as usize];
    Ok((0..height as usize)
        .flat_map(|y| bytemuck::cast_slice::<u8, [u8; 4]>(row(y)).iter().copied())
        .collect())
}

/// The first `count` elements of a buffer that can be copied from, when all work is done.
pub fn elements<T: AnyBitPattern + NoUninit>(
    gpu: &Gpu,
    buffer: &Buffer,
    count: usize,
) -> Result<Vec<T>> {
    let size = (count * size_of::<T>()) as u64;
    if size == 0 {
        return Ok(Vec::new());
    }
    let mut readback = Readback::new(gpu, size.next_multiple_of(4));
    gpu.check()?;
    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    readback.record(&mut encoder, buffer);
    readback.submitted(gpu.queue.submit([encoder.finish()]));
    let mut elements = readback.take(gpu, true)?.unwrap_or_default();
    elements.truncate(count);
    Ok(elements)
}

fn unreadable(gpu: &Gpu, why: &dyn std::fmt::Display) -> Error {
    Error::Gpu(format!("{}: cannot read back: {why}", gpu.info.name))
}

/// Reads the beginning of a buffer at one point of the recorded work, while later work continues.
/// A readback is reused: recorded, submitted, taken.
#[derive(Debug)]
pub struct Readback {
    staging: Buffer,
    mapped: Option<(SubmissionIndex, Receiver<std::result::Result<(), BufferAsyncError>>)>,
}

impl Readback {
    /// A readback of `bytes`, a multiple of four.
    pub fn new(gpu: &Gpu, bytes: u64) -> Self {
        let staging = gpu.device.create_buffer(&BufferDescriptor {
            label: Some("readback"),
            size: bytes,
            usage: BufferUsages::COPY_DST | BufferUsages::MAP_READ,
            mapped_at_creation: false,
        });
        Self { staging, mapped: None }
    }

    /// Records the copy, after the work that writes `buffer`.
    pub fn record(&self, encoder: &mut CommandEncoder, buffer: &Buffer) {
        encoder.copy_buffer_to_buffer(buffer, 0, &self.staging, 0, self.staging.size());
    }

    /// Tells that the copy was submitted.
    pub fn submitted(&mut self, submission: SubmissionIndex) {
        let (sender, receiver) = channel();
        self.staging.slice(..).map_async(MapMode::Read, move |result| {
            // An abandoned readback needs no wait.
            let _ = sender.send(result);
        });
        self.mapped = Some((submission, receiver));
    }

    /// The bytes read; `None` while the card has not reached the copy. `wait` waits for it.
    ///
    /// # Errors
    ///
    /// Errors of the card.
    pub fn take<T: AnyBitPattern + NoUninit>(
        &mut self,
        gpu: &Gpu,
        wait: bool,
    ) -> Result<Option<Vec<T>>> {
        let Some((submission, receiver)) = &self.mapped else { return Ok(None) };
        if wait {
            gpu.wait(Some(submission.clone()))?;
        } else {
            // A failed poll has a poorer message than a failed wait.
            let _ = gpu.device.poll(PollType::Poll);
            gpu.check()?;
        }
        match receiver.try_recv() {
            Ok(mapped) => mapped.map_err(|e| unreadable(gpu, &e))?,
            Err(TryRecvError::Empty) if !wait => return Ok(None),
            Err(e) => return Err(unreadable(gpu, &e)),
        }
        let view = self.staging.slice(..).get_mapped_range().map_err(|e| unreadable(gpu, &e))?;
        let numbers = bytemuck::pod_collect_to_vec(&view);
        drop(view);
        self.staging.unmap();
        self.mapped = None;
        Ok(Some(numbers))
    }
}
