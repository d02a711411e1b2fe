//! Times passes by the graphics card's timestamps, without waiting for it.

use super::device::Gpu;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use wgpu::{Buffer, BufferDescriptor, BufferUsages, CommandEncoder, Features, MapMode};
use wgpu::{QuerySet, QuerySetDescriptor, QueryType, RenderPassTimestampWrites};

/// Most passes in flight; more are not timed.
const SLOTS: usize = 4;
const BYTES: u64 = 16;

/// Times passes by timestamps written at their beginning and end.
#[derive(Debug)]
pub struct Timer {
    slots: Vec<TimerSlot>,
    period_ns: f64,
}

#[derive(Debug)]
struct TimerSlot {
    queries: QuerySet,
    resolved: Buffer,
    readable: Buffer,
    state: SlotState,
    ready: Arc<AtomicBool>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum SlotState {
    Free,
    Recorded,
    Mapping,
}

impl Timer {
    /// `None` where the card has no timestamps.
    pub fn new(gpu: &Gpu) -> Option<Self> {
        if !gpu.device.features().contains(Features::TIMESTAMP_QUERY) {
            return None;
        }
        let buffer = |usage| {
            gpu.device.create_buffer(&BufferDescriptor {
                label: Some("timestamps"),
                size: BYTES,
                usage,
                mapped_at_creation: false,
            })
        };
        let slot = |_| TimerSlot {
            queries: gpu.device.create_query_set(&QuerySetDescriptor {
                label: Some("timestamps"),
                ty: QueryType::Timestamp,
                count: 2,
            }),
            resolved: buffer(BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC),
            readable: buffer(BufferUsages::COPY_DST | BufferUsages::MAP_READ),
            state: SlotState::Free,
            ready: Arc::default(),
        };
        let period_ns = f64::from(gpu.queue.get_timestamp_period());
        Some(Self { slots: (0..SLOTS).map(slot).collect(), period_ns })
    }

    /// A slot for the next pass; `None` while all are in flight.
    pub fn begin(&mut self) -> Option<usize> {
        self.slots.iter().position(|s| s.state == SlotState::Free)
    }

    /// The timestamps that the pass of a slot must write.
    pub fn writes(&self, slot: usize) -> RenderPassTimestampWrites<'_> {
        RenderPassTimestampWrites {
            query_set: &self.slots[slot].queries,
            beginning_of_pass_write_index: Some(0),
            end_of_pass_write_index: Some(1),
        }
    }

    /// Records the readback after the pass of a slot.
    pub fn end(&mut self, slot: usize, encoder: &mut CommandEncoder) {
        let slot = &mut self.slots[slot];
        encoder.resolve_query_set(&slot.queries, 0..2, &slot.resolved, 0);
        encoder.copy_buffer_to_buffer(&slot.resolved, 0, &slot.readable, 0, BYTES);
        slot.state = SlotState::Recorded;
    }

    /// Starts to map the recorded readbacks; call this after submitting the work.
    pub fn submitted(&mut self) {
        for slot in self.slots.iter_mut().filter(|s| s.state == SlotState::Recorded) {
            let ready = slot.ready.clone();
            slot.readable.slice(..).map_async(MapMode::Read, move |result| {
                ready.store(result.is_ok(), Ordering::Release);
            });
            slot.state = SlotState::Mapping;
        }
    }

    /// Milliseconds of the passes that have finished since the last call.
    pub fn collect(&mut self) -> Vec<f64> {
        let mut times = Vec::new();
        for slot in self.slots.iter_mut().filter(|s| s.state == SlotState::Mapping) {
            if !slot.ready.swap(false, Ordering::Acquire) {
                continue;
            }
            if let Ok(view) = slot.readable.slice(..).get_mapped_range() {
                let stamps: [u64; 2] = bytemuck::pod_read_unaligned(&view);
                times.push(stamps[1].saturating_sub(stamps[0]) as f64 * self.period_ns * 1e-6);
            }
            slot.readable.unmap();
            slot.state = SlotState::Free;
        }
        times
    }
}
