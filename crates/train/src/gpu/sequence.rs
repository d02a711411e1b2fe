//! Passes one after the other.

use super::limits::{COUNTS, Count, DIGIT_BITS, GROUP, RADIX, REMEDY, SCAN_ITEMS, SORT_ITEMS};
use super::passes::Passes;
use glam::UVec2;
use std::collections::HashMap;
use trisplat_gpu::readback::elements;
use trisplat_gpu::{Gpu, Kernel, storage, uniform, workgroups};
use trisplat_scene::{Error, Result, Rng};
use wgpu::{
    BindGroup, BindingResource, Buffer, BufferBinding, CommandEncoder, ComputePass, ComputePipeline,
};

/// The number of workgroups of a pass.
#[derive(Debug, Clone, Copy)]
pub(super) enum Spread {
    /// One.
    Once,
    /// Enough for `items`, `each` per workgroup.
    Over(u32, u32),
    /// One per tile.
    Tiles(UVec2),
    /// A number that the card computed.
    Found(Groups),
}

/// Bind groups of earlier steps, by pass and buffers, because making them takes longer than
/// recording a step. They keep their buffers alive.
#[derive(Debug, Default)]
pub(super) struct BindGroups(HashMap<Bound, BindGroup>);

/// A pass, and its buffers with the places in them.
type Bound = (ComputePipeline, Vec<(Buffer, u64)>);

impl BindGroups {
    /// Drops all bind groups, before buffers go.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }

    fn get(&mut self, gpu: &Gpu, kernel: &Kernel, bindings: &[BindingResource<'_>]) -> &BindGroup {
        let buffer = |binding: &BindingResource<'_>| match binding {
            BindingResource::Buffer(part) => Some((part.buffer.clone(), part.offset)),
            _ => None,
        };
        let key = (kernel.pipeline().clone(), bindings.iter().filter_map(buffer).collect());
        self.0.entry(key).or_insert_with(|| kernel.bind(gpu, bindings))
    }
}

/// A sequence of passes that is being recorded.
pub(super) struct Sequence<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) bind_groups: &'a mut BindGroups,
    pub(super) jobs: &'a Jobs,
    pub(super) groups: &'a Buffer,
    pub(super) encoder: &'a mut CommandEncoder,
    pub(super) pass: Option<ComputePass<'static>>,
}

impl<'a> Sequence<'a> {
    /// A job as a binding.
    pub(super) fn job(&self, job: Job) -> BindingResource<'a> {
        self.jobs.get(job)
    }

    /// Adds a pass; its bindings are in the order of their numbers.
    pub(super) fn run(
        &mut self,
        kernel: &Kernel,
        spread: Spread,
        bindings: &[BindingResource<'_>],
    ) {
        let [x, y] = match spread {
            Spread::Once => [1, 1],
            Spread::Over(items, each) => workgroups(items.div_ceil(each)),
            Spread::Tiles(tiles) => tiles.to_array(),
            Spread::Found(_) => [1, 1],
        };
        if x * y == 0 {
            return;
        }
        let encoder = &mut *self.encoder;
        let begin = || encoder.begin_compute_pass(&Default::default()).forget_lifetime();
        let pass = self.pass.get_or_insert_with(begin);
        pass.set_pipeline(kernel.pipeline());
        pass.set_bind_group(0, self.bind_groups.get(self.gpu, kernel, bindings), &[]);
        match spread {
            Spread::Found(groups) => {
                pass.dispatch_workgroups_indirect(self.groups, groups as u64 * 12)
            }
            _ => pass.dispatch_workgroups(x, y, 1),
        }
    }
}

/// A whole buffer as a binding.
pub(super) fn all(buffer: &Buffer) -> BindingResource<'_> {
    buffer.as_entire_binding()
}

/// The passes of prefix sums and sorts, and the buffers between them.
pub(super) struct Ordering<'a> {
    pub(super) passes: &'a Passes,
    /// Has the lengths.
    pub(super) counts: &'a Buffer,
    /// A number for each digit and block of a sort.
    pub(super) histogram: &'a Buffer,
    /// A number for each block of a sum, or for each digit of a sort.
    pub(super) block_sums: &'a Buffer,
}

/// Keys and values of a sort.
pub(super) struct RadixSort<'a> {
    pub(super) length: Count,
    pub(super) blocks: Spread,
    pub(super) keys: &'a [Buffer; 2],
    pub(super) values: &'a [Buffer; 2],
}

impl Ordering<'_> {
    /// An exclusive prefix sum in place.
    pub(super) fn scan(&self, to: &mut Sequence<'_>, length: Count, blocks: Spread, data: &Buffer) {
        let passes = self.passes;
        let sums = all(self.block_sums);
        let job = to.job(scan(length));
        let counts = all(self.counts);
        let bindings = [job.clone(), counts.clone(), all(data), sums.clone()];
        to.run(&passes.scan_reduce, blocks, &bindings);
        to.run(&passes.scan_sums, Spread::Once, &[job, counts, sums]);
        to.run(&passes.scan_apply, blocks, &bindings);
    }

    /// A stable sort by the lowest `digits` of the keys; after an even number of them the result is
    /// in the first buffers.
    pub(super) fn sort(&self, to: &mut Sequence<'_>, sort: &RadixSort<'_>, digits: u32) {
        let histogram = self.histogram;
        let totals = self.block_sums;
        for at in 0..digits {
            let from = at as usize % 2;
            let into = 1 - at as usize % 2;
            let job = to.job(digit(sort.length, at * DIGIT_BITS));
            let counts = all(self.counts);
            let bindings = [job.clone(), counts.clone(), all(&sort.keys[from]), all(histogram)];
            to.run(&self.passes.sort_count, sort.blocks, &bindings);
            let bindings = [job.clone(), counts.clone(), all(histogram), all(totals)];
            to.run(&self.passes.sort_scan, Spread::Over(RADIX, 1), &bindings);
            let bindings = [
                job,
                counts,
                all(&sort.keys[from]),
                all(&sort.values[from]),
                all(histogram),
                all(totals),
                all(&sort.keys[into]),
                all(&sort.values[into]),
            ];
            to.run(&self.passes.sort_scatter, sort.blocks, &bindings);
        }
    }
}

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

/// Sums the first `numbers` values of all partial sums, whose number is a count, into the counts
/// from `place` on.
pub(super) const fn sum(place: Count, length: Count, numbers: u32) -> Job {
    [place as u32, length as u32, numbers, 0]
}

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
        let at = self.jobs.iter().position(|other| *other == job).unwrap_or_default() as u64;
        let size = std::num::NonZeroU64::new(size_of::<Job>() as u64);
        BindingResource::Buffer(BufferBinding {
            buffer: &self.buffer,
            offset: at * self.stride,
            size,
        })
    }
}

/// Numbers: several blocks; the last is not full.
const LENGTH: u32 = 3 * GROUP * SORT_ITEMS + 77;
const _: () = assert!(SCAN_ITEMS == SORT_ITEMS);

/// The numbers, before or after the operations.
#[derive(Debug, Clone, PartialEq)]
struct Numbers {
    /// Before the prefix sum, and after.
    sums: Vec<u32>,
    keys: Vec<u32>,
    /// The place of each key before the sort.
    places: Vec<u32>,
}

impl Numbers {
    /// Keys repeat, so that a sort that is not stable shows.
    fn new() -> Self {
        let rng = Rng::new(0, "self_test", 0);
        let at = |i: u32, bound: f32| (rng.uniform(u64::from(i)) * bound) as u32;
        let sums = (0..LENGTH).map(|i| at(i, 9.0)).collect();
        let keys = (0..LENGTH).map(|i| at(i, 3000.0).wrapping_mul(0x9e37_79b9)).collect();
        Self { sums, keys, places: (0..LENGTH).collect() }
    }

    /// The expected result.
    fn answer(&self) -> Self {
        let before = |sum: &mut u32, number: &u32| {
            *sum += number;
            Some(*sum - number)
        };
        let sums = self.sums.iter().scan(0, before).collect();
        let mut places = self.places.clone();
        places.sort_by_key(|place| self.keys[*place as usize]);
        Self { sums, keys: places.iter().map(|place| self.keys[*place as usize]).collect(), places }
    }

    /// The first operation that went wrong.
    fn fault(&self, result: &Self) -> Option<&'static str> {
        let answer = self.answer();
        let sorts = result.keys == answer.keys && result.places == answer.places;
        if result.sums != answer.sums {
            Some("prefix sums")
        } else if !sorts {
            Some("sorts")
        } else {
            None
        }
    }
}

/// Runs the test.
///
/// # Errors
///
/// A wrong result of the card, with the remedy; too little memory.
pub(super) fn self_test(gpu: &Gpu, passes: &Passes, jobs: &Jobs) -> Result<()> {
    let numbers = Numbers::new();
    let result = computed(gpu, passes, jobs, &numbers)?;
    judged(&gpu.info.name, numbers.fault(&result))
}

fn judged(card: &str, fault: Option<&str>) -> Result<()> {
    fault.map_or(Ok(()), |what| {
        Err(Error::Gpu(format!(
            "{card} computes wrong {what}, so it cannot train: update its driver, or train on the CPU (`backend` cpu)"
        )))
    })
}

/// The result of the card.
fn computed(gpu: &Gpu, passes: &Passes, jobs: &Jobs, numbers: &Numbers) -> Result<Numbers> {
    let buffer = |count: u32, data: &[u32]| -> Result<Buffer> {
        let buffer = storage(gpu, "self-test", 4 * u64::from(count), REMEDY)?;
        gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(data));
        Ok(buffer)
    };
    let empty = |count: u32| buffer(count, &[]);
    let mut lengths = [0; COUNTS];
    lengths[Count::Splats1 as usize] = LENGTH;
    lengths[Count::Splats as usize] = LENGTH;
    let counts = buffer(COUNTS as u32, &lengths)?;
    let sums = buffer(LENGTH, &numbers.sums)?;
    let keys = [buffer(LENGTH, &numbers.keys)?, empty(LENGTH)?];
    let values = [empty(LENGTH)?, empty(LENGTH)?];
    let blocks = LENGTH.div_ceil(GROUP * SORT_ITEMS);
    let histogram = empty(RADIX * blocks)?;
    let block_sums = empty(RADIX.max(blocks))?;

    let mut encoder = gpu.device.create_command_encoder(&Default::default());
    let mut bind_groups = BindGroups::default();
    let mut sequence = Sequence {
        gpu,
        bind_groups: &mut bind_groups,
        jobs,
        groups: &counts,
        encoder: &mut encoder,
        pass: None,
    };
    let ordering =
        Ordering { passes, counts: &counts, histogram: &histogram, block_sums: &block_sums };
    let blocks = Spread::Over(LENGTH, GROUP * SORT_ITEMS);
    ordering.scan(&mut sequence, Count::Splats1, blocks, &sums);
    let sort = RadixSort { length: Count::Splats, blocks, keys: &keys, values: &values };
    ordering.sort(&mut sequence, &sort, u32::BITS / DIGIT_BITS);
    drop(sequence);
    gpu.queue.submit([encoder.finish()]);
    gpu.check()?;
    let read = |buffer: &Buffer| elements::<u32>(gpu, buffer, LENGTH as usize);
    Ok(Numbers { sums: read(&sums)?, keys: read(&keys[0])?, places: read(&values[0])? })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_card_that_computes_something_wrong_is_refused_by_name() {
        let numbers = Numbers::new();
        let right = numbers.answer();
        assert_eq!(numbers.fault(&right), None);
        let mut stale = right.clone();
        stale.sums[2500] -= 1;
        let mut unstable = right.clone();
        let equal = unstable.keys.windows(2).position(|pair| pair[0] == pair[1]).unwrap();
        unstable.places.swap(equal, equal + 1);
        for (result, wants) in
            [(stale, "prefix sums"), (unstable, "sorts"), (numbers.clone(), "prefix sums")]
        {
            let message = judged("Card 9", numbers.fault(&result)).unwrap_err().to_string();
            assert!(
                message.contains("Card 9 computes wrong") && message.contains(wants),
                "{message}"
            );
            assert!(message.contains("`backend` cpu"), "{message}");
        }
    }
}
