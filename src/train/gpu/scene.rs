//! The scene and what Adam remembers of it, on the card.

use super::rows::{from_params, row_count, to_params};
use super::uniform::SceneShape;
use crate::error::{Error, Result};
use crate::gpu::Gpu;
use crate::gpu::readback::elements;
use crate::gpu::storage::storage;
use crate::raster::soft::Importance;
use crate::train::backend::BackendVisibility;
use crate::train::params::{Params, TrainState};
use wgpu::Buffer;

/// What to do when a scene does not fit.
pub(super) const REMEDY: &str = "train on the CPU (`backend` cpu), or with fewer triangles (`max_triangles`) or smaller photos (`max_size`)";

/// Numbers of [`SceneBuffers::visibility`] per triangle: largest weight, largest radius, photos, error (low and high half).
const VISIBILITY_NUMBERS: usize = 5;

/// Parameters, moments and visibility.
#[derive(Debug)]
pub(super) struct SceneBuffers {
    /// Parameters, as rows.
    pub(super) x: Buffer,
    /// Adam's first moments.
    pub(super) first: Buffer,
    /// Adam's second moments.
    pub(super) second: Buffer,
    pub(super) shape: SceneShape,
}

impl SceneBuffers {
    /// Moves a state to the card.
    pub(super) fn load(gpu: &Gpu, state: &TrainState) -> Result<Self> {
        let upload = |what, params: &Params| {
            let rows = from_params(params);
            let buffer = storage(gpu, what, size_of_val(rows.as_slice()) as u64, REMEDY)?;
            gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&rows));
            Ok::<_, Error>(buffer)
        };
        let count = |n: usize| {
            u32::try_from(n)
                .map_err(|_| Error::invalid("max_triangles", n, "fewer than 4294967296 on the card"))
        };
        Ok(Self {
            x: upload("parameters", &state.params)?,
            first: upload("first moments", &state.first)?,
            second: upload("second moments", &state.second)?,
            shape: SceneShape {
                triangles: count(state.params.len())?,
                pinned: count(state.pinned)?,
                frozen: count(state.frozen)?,
                sh_degree: state.params.sh_degree,
            },
        })
    }

    /// Reads the state back.
    pub(super) fn store(&self, gpu: &Gpu) -> Result<TrainState> {
        let (n, degree) = (self.shape.triangles as usize, self.shape.sh_degree);
        let numbers = row_count((usize::from(degree) + 1).pow(2)) * n;
        let read = |buffer| Ok::<_, Error>(to_params(&elements(gpu, buffer, numbers)?, n, degree));
        Ok(TrainState {
            params: read(&self.x)?,
            first: read(&self.first)?,
            second: read(&self.second)?,
            pinned: self.shape.pinned as usize,
            frozen: self.shape.frozen as usize,
        })
    }
}

/// How visible every triangle was: `[5, N]`, the twin of `record_visibility` in `passes/update.wgsl`.
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

    /// Reads it back and begins again.
    pub(super) fn take(&self, gpu: &Gpu) -> Result<BackendVisibility> {
        let n = self.triangles;
        let numbers: Vec<u32> = elements(gpu, &self.buffer, n * VISIBILITY_NUMBERS)?;
        let row = |j: usize| &numbers[j * n..(j + 1) * n];
        let floats = |j: usize| row(j).iter().copied().map(f32::from_bits).collect();
        let mut encoder = gpu.device.create_command_encoder(&Default::default());
        encoder.clear_buffer(&self.buffer, 0, None);
        gpu.queue.submit([encoder.finish()]);
        let mut first = Importance::new(n);
        (first.max_weight, first.max_radius_px) = (floats(0), floats(1));
        first.views = row(2).to_vec();
        let error = row(3).iter().zip(row(4)).map(|(&low, &high)| u64::from(low) | u64::from(high) << 32);
        Ok(BackendVisibility { first, again: Importance::default(), error: error.collect() })
    }
}
