//! The scene and Adam's moments, on the card.

use super::limits::{GROUP, REMEDY};
use super::uniform::{PhotoSource, SceneShape};
use crate::backend::{BackendVisibility, PhotoId, StepPhoto};
use crate::params::{OptimizerState, Params};
use glam::Vec3;
use std::collections::HashMap;
use std::ops::Range;
use trisplat_gpu::buffer::filled;
use trisplat_gpu::readback::elements;
use trisplat_gpu::{Gpu, storage, uniform};
use trisplat_raster::soft::Importance;
use trisplat_scene::parallel::{self, GRAIN};
use trisplat_scene::{Error, Result};
use wgpu::{BindingResource, Buffer, BufferBinding, BufferUsages};

/// Numbers of [`VisibilityBuffer`] per triangle: largest weight, largest radius, photos, error (low
/// and high half), sum of weights.
pub(super) const VISIBILITY_NUMBERS: usize = 7;

/// The scene, in chunks that fit a binding.
#[derive(Debug)]
pub(super) struct SceneBuffers {
    pub(super) chunks: Vec<ChunkBuffers>,
    pub(super) shape: SceneShape,
    /// For each chunk, the parameters for counting and for writing: twins of `Chunk` in
    /// `passes/step.wgsl`.
    parts: Buffer,
    stride: u64,
}

/// A chunk: triangles whose rows have separate buffers.
#[derive(Debug)]
pub(super) struct ChunkBuffers {
    pub(super) first: u32,
    pub(super) count: u32,
    /// Parameters, as rows.
    pub(super) x: Buffer,
    /// Adam's first moments.
    pub(super) first_moments: Buffer,
    /// Adam's second moments.
    pub(super) second_moments: Buffer,
}

/// Bytes per upload; the driver keeps a copy of each during the transfer.
const UPLOAD_BYTES: usize = 64 << 20;

impl SceneBuffers {
    /// Moves a state to the card, in chunks whose rows take `binding_bytes` at most.
    pub(super) fn load(gpu: &Gpu, state: &OptimizerState, binding_bytes: u64) -> Result<Self> {
        let count = |n: usize| {
            u32::try_from(n).map_err(|_| {
                Error::invalid("max_triangles", n, "fewer than 4294967296 on the card")
            })
        };
        let triangles = count(state.params.len())?;
        let each = chunk_triangles(row_count(state.params.sh_count()), binding_bytes)
            .min(triangles.max(1));
        let mut chunks = Vec::new();
        for first in (0..triangles.max(1)).step_by(each as usize) {
            let chunk = first as usize..(first.saturating_add(each).min(triangles)) as usize;
            chunks.push(ChunkBuffers {
                first,
                count: count(chunk.len())?,
                x: upload(gpu, "parameters", &state.params, chunk.clone())?,
                first_moments: moments(gpu, "first moments", &state.first, chunk.clone())?,
                second_moments: moments(gpu, "second moments", &state.second, chunk)?,
            });
        }
        let shape = SceneShape {
            triangles,
            pinned: count(state.pinned)?,
            frozen: count(state.frozen)?,
            sh_degree: state.params.sh_degree,
            chunk: each,
        };
        let stride = u64::from(gpu.device.limits().min_uniform_buffer_offset_alignment).max(16);
        let parts = uniform(gpu, "chunks", 2 * stride * chunks.len() as u64);
        for (chunk, at) in chunks.iter().zip(0..) {
            for writes in [0, 1] {
                let part = [chunk.first, chunk.count, writes, 0];
                let place = (2 * at + u64::from(writes)) * stride;
                gpu.queue.write_buffer(&parts, place, bytemuck::cast_slice(&part));
            }
        }
        gpu.check()?;
        Ok(Self { chunks, shape, parts, stride })
    }

    /// Chunk `at`, for a pass that counts or writes.
    pub(super) fn part(&self, at: usize, writes: u32) -> BindingResource<'_> {
        let offset = (2 * at as u64 + u64::from(writes)) * self.stride;
        let size = std::num::NonZeroU64::new(16);
        BindingResource::Buffer(BufferBinding { buffer: &self.parts, offset, size })
    }

    /// Reads the state back.
    pub(super) fn store(&self, gpu: &Gpu) -> Result<OptimizerState> {
        Ok(OptimizerState {
            params: self.params(gpu)?,
            first: self.read(gpu, |chunk| &chunk.first_moments)?,
            second: self.read(gpu, |chunk| &chunk.second_moments)?,
            pinned: self.shape.pinned as usize,
            frozen: self.shape.frozen as usize,
        })
    }

    /// Reads the parameters back.
    pub(super) fn params(&self, gpu: &Gpu) -> Result<Params> {
        self.read(gpu, |chunk| &chunk.x)
    }

    fn read(&self, gpu: &Gpu, of: impl Fn(&ChunkBuffers) -> &Buffer) -> Result<Params> {
        let mut params = Params { sh_degree: self.shape.sh_degree, ..Params::default() };
        let numbers = row_count(params.sh_count());
        for chunk in &self.chunks {
            let n = chunk.count as usize;
            append(&mut params, &elements(gpu, of(chunk), numbers * n)?, n);
        }
        Ok(params)
    }
}

/// Triangles of `numbers` numbers in a chunk: whole workgroups.
fn chunk_triangles(numbers: usize, binding_bytes: u64) -> u32 {
    let max_triangles = binding_bytes / (4 * numbers as u64);
    let max_triangles = u32::try_from(max_triangles).unwrap_or(u32::MAX - GROUP);
    (max_triangles / GROUP * GROUP).max(GROUP)
}

/// Moments of a trained scene; one that is only drawn has none.
fn moments(gpu: &Gpu, what: &str, params: &Params, chunk: Range<usize>) -> Result<Buffer> {
    if params.is_empty() { storage(gpu, what, 0, REMEDY) } else { upload(gpu, what, params, chunk) }
}

fn upload(gpu: &Gpu, what: &str, params: &Params, chunk: Range<usize>) -> Result<Buffer> {
    let rows = from_params(params, chunk);
    let buffer = storage(gpu, what, size_of_val(rows.as_slice()) as u64, REMEDY)?;
    let bytes: &[u8] = bytemuck::cast_slice(&rows);
    for (part, at) in bytes.chunks(UPLOAD_BYTES).zip((0u64..).step_by(UPLOAD_BYTES)) {
        gpu.queue.write_buffer(&buffer, at, part);
        if bytes.len() > UPLOAD_BYTES {
            let submission = gpu.queue.submit([]);
            gpu.wait(Some(submission))?;
        }
    }
    Ok(buffer)
}

/// Visibility of every triangle: `[7, N]`, the twin of `record_visibility` in `passes/update.wgsl`.
#[derive(Debug)]
pub(super) struct VisibilityBuffer {
    pub(super) buffer: Buffer,
    pub(super) triangles: usize,
}

impl VisibilityBuffer {
    /// Nothing seen yet.
    pub(super) fn new(gpu: &Gpu, triangles: usize) -> Result<Self> {
        let bytes = (triangles * VISIBILITY_NUMBERS * size_of::<u32>()) as u64;
        Ok(Self { buffer: storage(gpu, "visibility", bytes, REMEDY)?, triangles })
    }

    /// Reads it back and resets it.
    pub(super) fn take(&self, gpu: &Gpu) -> Result<BackendVisibility> {
        let n = self.triangles;
        let numbers: Vec<u32> = elements(gpu, &self.buffer, n * VISIBILITY_NUMBERS)?;
        let row = |j: usize| &numbers[j * n..(j + 1) * n];
        let floats = |j: usize| row(j).iter().copied().map(f32::from_bits).collect();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&self.buffer, 0, None);
        gpu.queue.submit([encoder.finish()]);
        let mut first = Importance::new(n);
        first.max_weight = floats(0);
        first.max_radius_px = floats(1);
        first.views = row(2).to_vec();
        first.sum_weight = floats(5);
        first.nearness = floats(6);
        let error =
            row(3).iter().zip(row(4)).map(|(&low, &high)| u64::from(low) | u64::from(high) << 32);
        Ok(BackendVisibility { first, again: Importance::default(), error: error.collect() })
    }
}

/// Rows before the SH.
const GEOMETRY_ROWS: usize = 11;

/// Numbers per triangle.
pub(super) fn row_count(sh_count: usize) -> usize {
    GEOMETRY_ROWS + 3 * sh_count
}

/// The rows of a chunk of `params`. `[11 + 3 K, N]`
pub(super) fn from_params(params: &Params, chunk: Range<usize>) -> Vec<f32> {
    let n = chunk.len();
    let k = params.sh_count();
    let vertices = &params.vertices[chunk.clone()];
    let sh = &params.sh[chunk.start * k..chunk.end * k];
    let mut rows = vec![0.0; row_count(k) * n];
    parallel::for_each(rows.chunks_mut(n.max(1)), |j, row| match j {
        0..9 => {
            for (x, corners) in row.iter_mut().zip(vertices) {
                *x = corners[j / 3][j % 3];
            }
        }
        9 => row.copy_from_slice(&params.opacity[chunk.clone()]),
        10 => row.copy_from_slice(&params.sigma[chunk.clone()]),
        _ => {
            let k_at = (j - GEOMETRY_ROWS) / 3;
            let c = (j - GEOMETRY_ROWS) % 3;
            for (x, sh) in row.iter_mut().zip(sh.chunks_exact(k)) {
                *x = sh[k_at][c];
            }
        }
    });
    rows
}

/// Appends a chunk of `n` to `params`.
pub(super) fn append(params: &mut Params, rows: &[f32], n: usize) {
    let k = params.sh_count();
    let at = |j: usize, i: usize| rows[j * n + i];
    let corner = |i: usize, c: usize| Vec3::new(at(3 * c, i), at(3 * c + 1, i), at(3 * c + 2, i));
    let coefficient = |m: usize| {
        let i = m / k;
        let first = GEOMETRY_ROWS + 3 * (m % k);
        [at(first, i), at(first + 1, i), at(first + 2, i)]
    };
    parallel::extend(&mut params.vertices, n, GRAIN, |i| {
        [corner(i, 0), corner(i, 1), corner(i, 2)]
    });
    params.opacity.extend_from_slice(&rows[9 * n..10 * n]);
    params.sigma.extend_from_slice(&rows[10 * n..11 * n]);
    parallel::extend(&mut params.sh, n * k, GRAIN, coefficient);
}

/// Photos on the card; the least recently used one leaves for a new one.
#[derive(Debug)]
pub(super) struct GpuPhotos {
    cached: HashMap<PhotoId, CachedPhoto>,
    bytes: u64,
    max_bytes: u64,
    uses: u64,
}

#[derive(Debug)]
struct CachedPhoto {
    buffer: Buffer,
    last_use: u64,
}

impl GpuPhotos {
    /// No photo yet, and never more than `max_bytes`.
    pub(super) fn new(max_bytes: u64) -> Self {
        Self { cached: HashMap::new(), bytes: 0, max_bytes, uses: 0 }
    }

    /// Keeps no photo from now on; true when this frees memory.
    pub(super) fn give_up(&mut self) -> bool {
        let any = !self.cached.is_empty();
        self.bytes = 0;
        self.max_bytes = 0;
        self.cached.clear();
        any
    }

    /// A photo, on the card if there is room for it.
    pub(super) fn get(&mut self, gpu: &Gpu, photo: &StepPhoto<'_>) -> PhotoSource {
        let bytes = 4 * photo.pixels.rgb.len() as u64;
        let id = photo.id.filter(|_| bytes <= self.max_bytes);
        let buffer = id.and_then(|id| self.cache(gpu, id, photo, bytes));
        buffer.map_or_else(|| PhotoSource::Packed(packed(photo)), PhotoSource::Held)
    }

    fn cache(
        &mut self,
        gpu: &Gpu,
        id: PhotoId,
        photo: &StepPhoto<'_>,
        bytes: u64,
    ) -> Option<Buffer> {
        self.uses += 1;
        if let Some(photo) = self.cached.get_mut(&id) {
            photo.last_use = self.uses;
            return Some(photo.buffer.clone());
        }
        while self.bytes + bytes > self.max_bytes {
            let oldest = *self.cached.iter().min_by_key(|(_, photo)| photo.last_use)?.0;
            self.bytes -= self.cached.remove(&oldest).map_or(0, |photo| photo.buffer.size());
        }
        let pixel = packed_pixel(photo);
        let usage = BufferUsages::COPY_SRC;
        match filled(gpu, "photo", usage, photo.pixels.rgb.len(), pixel) {
            Ok(buffer) => {
                self.bytes += buffer.size();
                self.cached.insert(id, CachedPhoto { buffer: buffer.clone(), last_use: self.uses });
                Some(buffer)
            }
            Err(_) => {
                // The card is full earlier than expected: its photos stay, new ones do not.
                self.max_bytes = self.bytes;
                None
            }
        }
    }
}

fn packed(photo: &StepPhoto<'_>) -> Vec<u32> {
    parallel::collect(photo.pixels.rgb.len(), GRAIN, packed_pixel(photo))
}

fn packed_pixel<'a>(photo: &StepPhoto<'a>) -> impl Fn(usize) -> u32 + Sync + use<'a> {
    let rgb = &photo.pixels.rgb;
    let alpha = photo.pixels.alpha.as_deref();
    move |i| {
        let [r, g, b] = rgb[i];
        u32::from_le_bytes([r, g, b, alpha.map_or(u8::MAX, |alpha| alpha[i])])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_whole_workgroups_that_can_be_bound() {
        // SH degree 3: 59 numbers; 128 MiB, 2 GiB less a byte, and hardly anything.
        assert_eq!(chunk_triangles(59, 128 << 20), 568_576);
        assert_eq!(chunk_triangles(59, (2 << 30) - 1), 9_099_264 / GROUP * GROUP);
        assert_eq!(chunk_triangles(59, 1), GROUP);
        assert_eq!(chunk_triangles(14, u64::MAX) % GROUP, 0);
    }
}

#[cfg(test)]
mod rows_tests {
    use super::*;
    use trisplat_scene::{Rng, sh_count};

    #[test]
    fn rows_hold_every_number_once() {
        for degree in 0..=3u8 {
            let rng = Rng::new(5, "rows", 0);
            let n = 7;
            let k = sh_count(degree);
            let number = |i: usize| rng.uniform(i as u64);
            let params = Params {
                vertices: (0..n)
                    .map(|i| [0, 1, 2].map(|c| Vec3::splat(number(3 * i + c))))
                    .collect(),
                opacity: (0..n).map(|i| number(100 + i)).collect(),
                sigma: (0..n).map(|i| number(200 + i)).collect(),
                sh: (0..n * k).map(|m| [0, 1, 2].map(|c| number(300 + 3 * m + c))).collect(),
                sh_degree: degree,
            };
            let mut back = Params { sh_degree: degree, ..Params::default() };
            for chunk in [0..3, 3..5, 5..n] {
                let rows = from_params(&params, chunk.clone());
                assert_eq!(rows.len(), row_count(k) * chunk.len());
                append(&mut back, &rows, chunk.len());
            }
            assert_eq!(back, params);
        }
    }
}
