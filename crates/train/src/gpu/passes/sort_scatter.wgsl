// One digit of a stable radix sort: every key to its place. A workgroup first sorts its block in workgroup memory, by one half of
// the digit after the other: an invocation has consecutive keys and counts them half by half, and the prefix sum of these
// counts, over values and over invocations within a value, gives each key's place. So neighbours are written next to each other.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> histogram: array<u32>; // after the prefix sum within every digit
@group(0) @binding(5) var<storage, read> totals: array<u32>;    // digit by digit
@group(0) @binding(6) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(7) var<storage, read_write> values_out: array<u32>;

const SORT_BLOCK: u32 = GROUP * SORT_ITEMS;

// Two counts of 16 bits in a number: invocations 2 i and 2 i + 1, of each value of half a digit.
var<workgroup> tally: array<atomic<u32>, 8u * GROUP>;
// The digit and the place in the block of each key, so far sorted.
var<workgroup> sorted: array<u32, SORT_BLOCK>;
// Of each digit: its first place in the block, and in the output.
var<workgroup> firsts: array<u32, RADIX>;
var<workgroup> bases: array<u32, RADIX>;

// Sorts the block by four bits; before and after it all invocations must meet.
fn sort_half(shift: u32, local: u32, count: u32) {
    for (var k = local; k < 8u * GROUP; k += GROUP) {
        atomicStore(&tally[k], 0u);
    }
    workgroupBarrier();
    let first = local * SORT_ITEMS;
    let half = 16u * (local & 1u);
    var items: array<u32, SORT_ITEMS>;
    var rank: array<u32, SORT_ITEMS>;
    for (var k = 0u; k < SORT_ITEMS; k++) {
        items[k] = sorted[first + k];
        if first + k < count {
            let value = items[k] >> shift & 15u;
            rank[k] = atomicAdd(&tally[value * (GROUP / 2u) + local / 2u], 1u << half) >> half & 0xffffu;
        }
    }
    workgroupBarrier();
    // Each invocation sums a run of counts.
    var sum = 0u;
    for (var k = 8u * local; k < 8u * local + 8u; k++) {
        let pair = atomicLoad(&tally[k]);
        sum += (pair & 0xffffu) + (pair >> 16u);
    }
    var before = exclusive_sum(local, sum);
    for (var k = 8u * local; k < 8u * local + 8u; k++) {
        let pair = atomicLoad(&tally[k]);
        let low = pair & 0xffffu;
        atomicStore(&tally[k], before | ((before + low) << 16u));
        before += low + (pair >> 16u);
    }
    workgroupBarrier();
    for (var k = 0u; k < SORT_ITEMS; k++) {
        if first + k < count {
            let value = items[k] >> shift & 15u;
            let at = atomicLoad(&tally[value * (GROUP / 2u) + local / 2u]) >> half & 0xffffu;
            sorted[at + rank[k]] = items[k];
        }
    }
}

@compute @workgroup_size(GROUP)
fn sort_scatter(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = workgroup_index(workgroup, workgroups);
    let length = counts[job.length_at];
    let blocks = (length + SORT_BLOCK - 1u) / SORT_BLOCK;
    let first = min(block, blocks) * SORT_BLOCK;
    let count = min(max(length, first) - first, SORT_BLOCK);
    for (var k = local; k < count; k += GROUP) {
        sorted[k] = (keys[first + k] >> job.shift & (RADIX - 1u)) << 16u | k;
    }
    bases[local] = exclusive_sum(local, totals[local]);
    if block < blocks {
        bases[local] += histogram[local * blocks + block];
    }
    sort_half(16u, local, count);
    workgroupBarrier();
    sort_half(20u, local, count);
    workgroupBarrier();
    for (var k = local; k < count; k += GROUP) {
        let digit = sorted[k] >> 16u;
        if k == 0u || sorted[max(k, 1u) - 1u] >> 16u != digit {
            firsts[digit] = k;
        }
    }
    workgroupBarrier();
    for (var k = local; k < count; k += GROUP) {
        let digit = sorted[k] >> 16u;
        let source = first + (sorted[k] & 0xffffu);
        let to = bases[digit] + k - firsts[digit];
        keys_out[to] = keys[source];
        if job.identity == 1u {
            values_out[to] = source;
        } else {
            values_out[to] = values[source];
        }
    }
}
