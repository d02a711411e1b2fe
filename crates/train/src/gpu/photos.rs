//! Photos that stay on the card while there is memory for them.

use crate::backend::{PhotoId, StepPhoto};
use std::collections::HashMap;
use trisplat_gpu::Gpu;
use trisplat_gpu::buffer::filled;
use trisplat_scene::parallel::{self, GRAIN};
use wgpu::{Buffer, BufferUsages, CommandEncoder};

/// A photo of a step: a pixel's colour and weight in 8 bits each, lowest first.
#[derive(Debug)]
pub(super) enum PhotoSource {
    /// On the card.
    Held(Buffer),
    /// In main memory.
    Packed(Vec<u32>),
}

impl PhotoSource {
    /// Copies it to `to`, before all later recorded passes.
    pub(super) fn copy(&self, gpu: &Gpu, encoder: &mut CommandEncoder, to: &Buffer) {
        match self {
            Self::Held(buffer) => encoder.copy_buffer_to_buffer(buffer, 0, to, 0, buffer.size()),
            Self::Packed(pixels) => gpu.queue.write_buffer(to, 0, bytemuck::cast_slice(pixels)),
        }
    }
}

/// The photos on the card. The one that was used least recently leaves for a new one.
#[derive(Debug)]
pub(super) struct Photos {
    held: HashMap<PhotoId, HeldPhoto>,
    bytes: u64,
    most_bytes: u64,
    uses: u64,
}

#[derive(Debug)]
struct HeldPhoto {
    buffer: Buffer,
    last_use: u64,
}

impl Photos {
    /// None yet, and never more than `most_bytes`.
    pub(super) fn new(most_bytes: u64) -> Self {
        Self { held: HashMap::new(), bytes: 0, most_bytes, uses: 0 }
    }

    /// Forgets them; true when this frees memory.
    pub(super) fn clear(&mut self) -> bool {
        let any = !self.held.is_empty();
        self.held.clear();
        self.bytes = 0;
        any
    }

    /// Keeps no photo from now on; true when this frees memory.
    pub(super) fn give_up(&mut self) -> bool {
        self.most_bytes = 0;
        self.clear()
    }

    /// A photo, on the card if there is room for it.
    pub(super) fn get(&mut self, gpu: &Gpu, photo: &StepPhoto<'_>) -> PhotoSource {
        let bytes = 4 * photo.pixels.rgb.len() as u64;
        let id = photo.id.filter(|_| bytes <= self.most_bytes);
        let held = id.and_then(|id| self.hold(gpu, id, photo, bytes));
        held.map_or_else(|| PhotoSource::Packed(packed(photo)), PhotoSource::Held)
    }

    fn hold(&mut self, gpu: &Gpu, id: PhotoId, photo: &StepPhoto<'_>, bytes: u64) -> Option<Buffer> {
        self.uses += 1;
        if let Some(held) = self.held.get_mut(&id) {
            held.last_use = self.uses;
            return Some(held.buffer.clone());
        }
        while self.bytes + bytes > self.most_bytes {
            let oldest = *self.held.iter().min_by_key(|(_, held)| held.last_use)?.0;
            self.bytes -= self.held.remove(&oldest).map_or(0, |held| held.buffer.size());
        }
        let pixel = packed_pixel(photo);
        let usage = BufferUsages::COPY_SRC;
        match filled(gpu, "photo", usage, photo.pixels.rgb.len(), pixel) {
            Ok(buffer) => {
                self.bytes += buffer.size();
                self.held.insert(id, HeldPhoto { buffer: buffer.clone(), last_use: self.uses });
                Some(buffer)
            }
            Err(_) => {
                // The card is full earlier than expected: its photos stay, new ones do not.
                self.most_bytes = self.bytes;
                None
            }
        }
    }
}

fn packed(photo: &StepPhoto<'_>) -> Vec<u32> {
    parallel::collect(photo.pixels.rgb.len(), GRAIN, packed_pixel(photo))
}

fn packed_pixel<'a>(photo: &StepPhoto<'a>) -> impl Fn(usize) -> u32 + Sync + use<'a> {
    let (rgb, alpha) = (&photo.pixels.rgb, photo.pixels.alpha.as_deref());
    move |i| {
        let [r, g, b] = rgb[i];
        u32::from_le_bytes([r, g, b, alpha.map_or(u8::MAX, |alpha| alpha[i])])
    }
}
