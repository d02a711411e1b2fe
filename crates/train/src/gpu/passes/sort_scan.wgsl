// One digit of a stable radix sort: the prefix sum of the counts of one value over all blocks, and their sum. A workgroup is a value.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;   // digit by digit, block by block
@group(0) @binding(3) var<storage, read_write> totals: array<u32>; // digit by digit

@compute @workgroup_size(GROUP)
fn sort_scan(@builtin(workgroup_id) workgroup: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let length = counts[job.length_at];
    let blocks = (length + GROUP * SORT_ITEMS - 1u) / (GROUP * SORT_ITEMS);
    let sum = scan_run(workgroup.x * blocks, blocks, local);
    if local == GROUP - 1u {
        totals[workgroup.x] = sum;
    }
}
