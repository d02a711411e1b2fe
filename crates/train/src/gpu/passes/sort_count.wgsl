// One digit of a stable radix sort: counts each value of the digit in each block of keys.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> histogram: array<u32>; // digit by digit, block by block

var<workgroup> found: array<atomic<u32>, RADIX>;

@compute @workgroup_size(GROUP)
fn sort_count(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = workgroup_index(workgroup, workgroups);
    let length = counts[job.length_at];
    let blocks = (length + GROUP * SORT_ITEMS - 1u) / (GROUP * SORT_ITEMS);
    if local < RADIX {
        atomicStore(&found[local], 0u);
    }
    workgroupBarrier();
    let first = block * GROUP * SORT_ITEMS + local;
    for (var k = 0u; k < SORT_ITEMS; k++) {
        let i = first + k * GROUP;
        if i < length {
            atomicAdd(&found[(keys[i] >> job.shift) & (RADIX - 1u)], 1u);
        }
    }
    workgroupBarrier();
    if local < RADIX && block < blocks {
        histogram[local * blocks + block] = atomicLoad(&found[local]);
    }
}
