//! Parameters of passes that are used several times, and the places of their lengths in the counts.

use trisplat_gpu::{Gpu, uniform};
use trisplat_scene::Result;
use wgpu::{BindingResource, Buffer, BufferBinding};

/// Places in the buffer of counts; the twin of the constants in `passes/step.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
#[allow(dead_code, reason = "some are read and written on the card only")]
pub(super) enum Count {
    Triangles1,
    Splats,
    Splats1,
    Pairs,
    Pixels1,
    Layers,
    WantedSplats,
    WantedPairs,
    WantedLayers,
    Touched,
    Dropped,
    LossL1,
    LossMse,
    LossSsim,
    LossGeometry,
    SumArea,
    PhotoTiles,
    SceneGroups,
    FrameGroups,
}

/// Counts in the buffer.
pub(super) const COUNTS: usize = Count::FrameGroups as usize + 1;

/// The indirect dispatches of a step. The twin of `set_groups` in `passes/plan.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u32)]
pub(super) enum Groups {
    Splats,
    SplatSort,
    SplatScan,
    Gather,
    PairSort,
    Buckets,
    Update,
}

/// Indirect dispatches.
pub(super) const GROUPS: usize = Groups::Update as usize + 1;

/// Parameters of one use of a pass: the twin of `Job` in `passes/step.wgsl`, or of `Sum` in
/// `passes/sum_partials.wgsl`.
pub(super) type Job = [u32; 4];

/// Counts, or writes.
pub(super) const fn turn(writes: u32) -> Job {
    [writes, 0, 0, 0]
}

/// A prefix sum; a count gives its length.
pub(super) const fn scan(length: Count) -> Job {
    [0, length as u32, 0, 0]
}

/// One digit of a sort; the values of the first are indices.
pub(super) const fn digit(length: Count, shift: u32) -> Job {
    [0, length as u32, shift, (shift == 0) as u32]
}

/// Sums the first `numbers` values of all partial sums, whose number is a count, into the counts from `place`
/// on.
pub(super) const fn sum(place: Count, length: Count, numbers: u32) -> Job {
    [place as u32, length as u32, numbers, 0]
}

/// Bits of a digit of the sorts.
pub(super) const DIGIT_BITS: u32 = 8;

/// All jobs, in a buffer that never changes.
#[derive(Debug)]
pub(super) struct Jobs {
    jobs: Vec<Job>,
    buffer: Buffer,
    stride: u64,
}

impl Jobs {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let mut jobs: Vec<Job> = (0..3).map(turn).collect();
        jobs.extend([Count::Triangles1, Count::Splats1, Count::Pixels1].map(scan));
        for shift in (0..u32::BITS).step_by(DIGIT_BITS as usize) {
            jobs.extend([digit(Count::Splats, shift), digit(Count::Pairs, shift)]);
        }
        jobs.push(sum(Count::LossL1, Count::PhotoTiles, 3));
        jobs.push(sum(Count::SumArea, Count::SceneGroups, 1));
        jobs.push(sum(Count::LossGeometry, Count::FrameGroups, 1));
        let stride = u64::from(gpu.device.limits().min_uniform_buffer_offset_alignment).max(16);
        let buffer = uniform(gpu, "jobs", stride * jobs.len() as u64);
        for (job, at) in jobs.iter().zip(0..) {
            gpu.queue.write_buffer(&buffer, at * stride, bytemuck::cast_slice(job));
        }
        gpu.check()?;
        Ok(Self { jobs, buffer, stride })
    }

    /// One of them as a binding.
    pub(super) fn get(&self, job: Job) -> BindingResource<'_> {
        let at = self.jobs.iter().position(|known| *known == job).unwrap_or_default() as u64;
        let size = std::num::NonZeroU64::new(size_of::<Job>() as u64);
        BindingResource::Buffer(BufferBinding { buffer: &self.buffer, offset: at * self.stride, size })
    }
}
