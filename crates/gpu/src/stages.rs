//! Times each stage of a sequence of compute passes by the card's timestamps.

use super::device::Gpu;
use super::readback::elements;
use trisplat_scene::Result;
use wgpu::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder, ComputePassTimestampWrites, Features};
use wgpu::{QuerySet, QuerySetDescriptor, QueryType};

/// Times the stages of one sequence at a time.
#[derive(Debug)]
pub struct StageTimer {
    queries: QuerySet,
    resolved: Buffer,
    period_ns: f64,
    names: Vec<&'static str>,
}

/// Most stages of a sequence; more are not timed.
const MOST: u32 = 64;

impl StageTimer {
    /// `None` where the card has no timestamps.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.device.features().contains(Features::TIMESTAMP_QUERY) {
            return None;
        }
        Some(Self {
            queries: gpu.device.create_query_set(&QuerySetDescriptor {
                label: Some("stages"),
                ty: QueryType::Timestamp,
                count: 2 * MOST,
            }),
            resolved: gpu.device.create_buffer(&BufferDescriptor {
                label: Some("stages"),
                size: 16 * u64::from(MOST),
                usage: BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC,
                mapped_at_creation: false,
            }),
            period_ns: f64::from(gpu.queue.get_timestamp_period()),
            names: Vec::new(),
        })
    }

    /// A new sequence.
    pub fn begin(&mut self) {
        self.names.clear();
    }

    /// The timestamps that the pass of the next stage must write; `None` for too many.
    pub fn writes(&mut self, name: &'static str) -> Option<ComputePassTimestampWrites<'_>> {
        let at = u32::try_from(self.names.len()).ok().filter(|at| *at < MOST)?;
        self.names.push(name);
        Some(ComputePassTimestampWrites {
            query_set: &self.queries,
            beginning_of_pass_write_index: Some(2 * at),
            end_of_pass_write_index: Some(2 * at + 1),
        })
    }

    /// Records the copy of the timestamps after the last stage.
    pub fn end(&self, encoder: &mut CommandEncoder) {
        encoder.resolve_query_set(&self.queries, 0..2 * self.names.len() as u32, &self.resolved, 0);
    }

    /// Names and milliseconds of the stages, when all work is done.
    pub fn times(&self, gpu: &Gpu) -> Result<Vec<(&'static str, f64)>> {
        let stamps: Vec<u64> = elements(gpu, &self.resolved, 2 * self.names.len())?;
        let ms = |pair: &[u64]| pair[1].saturating_sub(pair[0]) as f64 * self.period_ns * 1e-6;
        Ok(self.names.iter().copied().zip(stamps.chunks_exact(2).map(ms)).collect())
    }
}
