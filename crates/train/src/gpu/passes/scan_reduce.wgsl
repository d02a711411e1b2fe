// First of three passes of an exclusive prefix sum: the sum of every block.

@group(0) @binding(0) var<uniform> job: Job;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> data: array<u32>;
@group(0) @binding(3) var<storage, read_write> sums: array<u32>;

alias Addend = u32;

@compute @workgroup_size(GROUP)
fn scan_reduce(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = workgroup_index(workgroup, workgroups);
    let length = counts[job.length_at];
    let first = block * GROUP * SCAN_ITEMS + local;
    var sum = 0u;
    for (var k = 0u; k < SCAN_ITEMS; k++) {
        let i = first + k * GROUP;
        if i < length {
            sum += data[i];
        }
    }
    let total = group_sum(local, sum);
    if local == 0u && block * GROUP * SCAN_ITEMS < length {
        sums[block] = total;
    }
}
