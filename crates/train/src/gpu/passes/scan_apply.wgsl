// Last of three passes of an exclusive prefix sum: every block, from its sum on.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read_write> data: array<u32>;
@group(0) @binding(3) var<storage, read> sums: array<u32>;

@compute @workgroup_size(GROUP)
fn scan_apply(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = workgroup_index(workgroup, workgroups);
    let length = counts[job.length_at];
    let first = (block * GROUP + local) * SCAN_ITEMS;
    var values: array<u32, SCAN_ITEMS>;
    var sum = 0u;
    for (var k = 0u; k < SCAN_ITEMS; k++) {
        values[k] = 0u;
        if first + k < length {
            values[k] = data[first + k];
        }
        sum += values[k];
    }
    var before = exclusive_sum(local, sum);
    if first < length {
        before += sums[block];
    }
    for (var k = 0u; k < SCAN_ITEMS; k++) {
        if first + k < length {
            data[first + k] = before;
        }
        before += values[k];
    }
}
