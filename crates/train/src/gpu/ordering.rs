//! Prefix sums and sorts on the card.

use super::job::{Count, DIGIT_BITS, digit, scan};
use super::passes::Passes;
use super::sequence::{Sequence, Spread, all};
use super::source::RADIX;
use wgpu::Buffer;

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

/// What is sorted.
pub(super) struct Sort<'a> {
    pub(super) length: Count,
    pub(super) blocks: Spread,
    pub(super) keys: &'a [Buffer; 2],
    pub(super) values: &'a [Buffer; 2],
}

impl Ordering<'_> {
    /// An exclusive prefix sum in place.
    pub(super) fn scan(&self, to: &mut Sequence<'_>, length: Count, blocks: Spread, data: &Buffer) {
        let (passes, sums) = (self.passes, all(self.block_sums));
        let (job, counts) = (to.job(scan(length)), all(self.counts));
        let bindings = [job.clone(), counts.clone(), all(data), sums.clone()];
        to.run(&passes.scan_reduce, blocks, &bindings);
        to.run(&passes.scan_sums, Spread::Once, &[job, counts, sums]);
        to.run(&passes.scan_apply, blocks, &bindings);
    }

    /// A stable sort by the lowest `digits` of the keys; after an even number of them the result is in the first
    /// buffers.
    pub(super) fn sort(&self, to: &mut Sequence<'_>, sort: &Sort<'_>, digits: u32) {
        let (histogram, totals) = (self.histogram, self.block_sums);
        for at in 0..digits {
            let (from, into) = (at as usize % 2, 1 - at as usize % 2);
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
