// Second of three passes of an exclusive prefix sum: the sums of the blocks, by one workgroup.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;

@compute @workgroup_size(GROUP)
fn scan_sums(@builtin(local_invocation_index) local: u32) {
    let blocks = (counts[job.length_at] + GROUP * SCAN_ITEMS - 1u) / (GROUP * SCAN_ITEMS);
    let each = (blocks + GROUP - 1u) / GROUP;
    let first = min(local * each, blocks);
    let end = min(first + each, blocks);
    var sum = 0u;
    for (var i = first; i < end; i++) {
        sum += sums[i];
    }
    var before = exclusive_sum(local, sum);
    for (var i = first; i < end; i++) {
        let value = sums[i];
        sums[i] = before;
        before += value;
    }
}
