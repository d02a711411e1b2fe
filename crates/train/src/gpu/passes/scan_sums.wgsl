// Second of three passes of an exclusive prefix sum: the sums of the blocks, by one workgroup.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(GROUP)
fn scan_sums(@builtin(local_invocation_index) local: u32) {
    let blocks = (counts[job.length_at] + GROUP * SCAN_ITEMS - 1u) / (GROUP * SCAN_ITEMS);
    scan_run(0u, blocks, local);
}
