// One digit of a stable radix sort: every key to its place. An invocation has consecutive keys, and counts
// them digit by digit. The prefix sum of these counts, over digits and over invocations within a digit, gives
// each key's place in its block.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> histogram: array<u32>; // after the prefix sum
@group(0) @binding(5) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> values_out: array<u32>;

// Two counts of 16 bits in a number: invocations 2 i and 2 i + 1.
var<workgroup> tally: array<atomic<u32>, SORT_TALLY>;

fn tally_of(digit: u32, local: u32) -> u32 {
    return (atomicLoad(&tally[digit * (GROUP / 2u) + local / 2u]) >> (16u * (local & 1u))) & 0xffffu;
}

@compute @workgroup_size(GROUP)
fn sort_scatter(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = workgroup_index(workgroup, workgroups);
    let length = counts[job.length_at];
    let blocks = (length + GROUP * SORT_ITEMS - 1u) / (GROUP * SORT_ITEMS);
    for (var k = local; k < SORT_TALLY; k += GROUP) {
        atomicStore(&tally[k], 0u);
    }
    workgroupBarrier();
    let first = (block * GROUP + local) * SORT_ITEMS;
    let mine = local / 2u;
    let one = 1u << (16u * (local & 1u));
    var rank: array<u32, SORT_ITEMS>;
    for (var k = 0u; k < SORT_ITEMS; k++) {
        rank[k] = 0u;
        if first + k < length {
            let digit = (keys[first + k] >> job.shift) & (RADIX - 1u);
            let before = atomicAdd(&tally[digit * (GROUP / 2u) + mine], one);
            rank[k] = (before >> (16u * (local & 1u))) & 0xffffu;
        }
    }
    workgroupBarrier();
    // Each invocation sums a run of counts; a run lies within one digit.
    let run = SORT_TALLY / GROUP;
    var sum = 0u;
    for (var k = 0u; k < run; k++) {
        let pair = atomicLoad(&tally[local * run + k]);
        sum += (pair & 0xffffu) + (pair >> 16u);
    }
    var before = exclusive_sum(local, sum);
    for (var k = 0u; k < run; k++) {
        let pair = atomicLoad(&tally[local * run + k]);
        let low = pair & 0xffffu;
        atomicStore(&tally[local * run + k], before | ((before + low) << 16u));
        before += low + (pair >> 16u);
    }
    workgroupBarrier();
    for (var k = 0u; k < SORT_ITEMS; k++) {
        let i = first + k;
        if i < length {
            let key = keys[i];
            let digit = (key >> job.shift) & (RADIX - 1u);
            let within = tally_of(digit, local) - tally_of(digit, 0u) + rank[k];
            let to = histogram[digit * blocks + block] + within;
            keys_out[to] = key;
            if job.identity == 1u {
                values_out[to] = i;
            } else {
                values_out[to] = values[i];
            }
        }
    }
}
