//! A test of the card and its driver before a run: prefix sum and sort, on which every step rests, of numbers whose answer is
//! known. Both need workgroup memory, barriers and atomics to work across a workgroup's subgroups.

use super::job::{COUNTS, Count, DIGIT_BITS, Jobs};
use super::ordering::{Ordering, Sort};
use super::passes::Passes;
use super::scene::REMEDY;
use super::sequence::{BindGroups, Sequence, Spread};
use super::source::{GROUP, RADIX, SCAN_ITEMS, SORT_ITEMS};
use trisplat_gpu::{Gpu, readback::elements, storage};
use trisplat_scene::{Error, Result, Rng};
use wgpu::Buffer;

/// Numbers: several blocks; the last is not full.
const LENGTH: u32 = 3 * GROUP * SORT_ITEMS + 77;
const _: () = assert!(SCAN_ITEMS == SORT_ITEMS);

/// The numbers, or what became of them.
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
        let at = |i: u32, most: f32| (rng.uniform(u64::from(i)) * most) as u32;
        let sums = (0..LENGTH).map(|i| at(i, 9.0)).collect();
        let keys = (0..LENGTH).map(|i| at(i, 3000.0).wrapping_mul(0x9e37_79b9)).collect();
        Self { sums, keys, places: (0..LENGTH).collect() }
    }

    /// What must come out.
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
    fn fault(&self, found: &Self) -> Option<&'static str> {
        let answer = self.answer();
        let sorts = found.keys == answer.keys && found.places == answer.places;
        match (found.sums == answer.sums, sorts) {
            (false, _) => Some("prefix sums"),
            (true, false) => Some("sorts"),
            (true, true) => None,
        }
    }
}

/// Runs the test. Errors: the card computes something else, with the way around; memory.
pub(super) fn self_test(gpu: &Gpu, passes: &Passes, jobs: &Jobs) -> Result<()> {
    let numbers = Numbers::new();
    let found = computed(gpu, passes, jobs, &numbers)?;
    judged(&gpu.info.name, numbers.fault(&found))
}

fn judged(card: &str, fault: Option<&str>) -> Result<()> {
    fault.map_or(Ok(()), |what| {
        Err(Error::Gpu(format!(
            "{card} computes wrong {what}, so it cannot train: update its driver, or train on the CPU (`backend` cpu)"
        )))
    })
}

/// What the card makes of the numbers.
fn computed(gpu: &Gpu, passes: &Passes, jobs: &Jobs, numbers: &Numbers) -> Result<Numbers> {
    let buffer = |count: u32, data: &[u32]| -> Result<Buffer> {
        let buffer = storage(gpu, "self-test", 4 * u64::from(count), REMEDY)?;
        gpu.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(data));
        Ok(buffer)
    };
    let empty = |count: u32| buffer(count, &[]);
    let mut lengths = [0; COUNTS];
    (lengths[Count::Splats1 as usize], lengths[Count::Splats as usize]) = (LENGTH, LENGTH);
    let counts = buffer(COUNTS as u32, &lengths)?;
    let sums = buffer(LENGTH, &numbers.sums)?;
    let keys = [buffer(LENGTH, &numbers.keys)?, empty(LENGTH)?];
    let values = [empty(LENGTH)?, empty(LENGTH)?];
    let blocks = LENGTH.div_ceil(GROUP * SORT_ITEMS);
    let (histogram, block_sums) = (empty(RADIX * blocks)?, empty(RADIX.max(blocks))?);

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
    let ordering = Ordering { passes, counts: &counts, histogram: &histogram, block_sums: &block_sums };
    let blocks = Spread::Over(LENGTH, GROUP * SORT_ITEMS);
    ordering.scan(&mut sequence, Count::Splats1, blocks, &sums);
    let sort = Sort { length: Count::Splats, blocks, keys: &keys, values: &values };
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
        for (found, wants) in [(stale, "prefix sums"), (unstable, "sorts"), (numbers.clone(), "prefix sums")]
        {
            let message = judged("Card 9", numbers.fault(&found)).unwrap_err().to_string();
            assert!(message.contains("Card 9 computes wrong") && message.contains(wants), "{message}");
            assert!(message.contains("`backend` cpu"), "{message}");
        }
    }
}
