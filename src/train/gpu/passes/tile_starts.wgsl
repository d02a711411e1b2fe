// Where each tile begins in the sorted pairs.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> tiles: array<u32>;
@group(0) @binding(3) var<storage, read_write> starts: array<u32>;

@compute @workgroup_size(GROUP)
fn tile_starts(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = workgroup_index(workgroup, workgroups) * GROUP + local;
    if tile > step.frame.z * step.frame.w {
        return;
    }
    var low = 0u;
    var high = counts[PAIRS];
    while low < high {
        let middle = (low + high) / 2u;
        if tiles[middle] < tile {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    starts[tile] = low;
}
