// Where each tile begins in the sorted pairs, and which tile each bucket belongs to.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> counts: array<u32>;
@group(0) @binding(2) var<storage, read> tiles: array<u32>;
@group(0) @binding(3) var<storage, read_write> table: array<u32>;

fn start_of(tile: u32) -> u32 {
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
    return low;
}

@compute @workgroup_size(GROUP)
fn tile_starts(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = workgroup_index(workgroup, workgroups) * GROUP + local;
    if tile > tile_total() {
        return;
    }
    let start = start_of(tile);
    table[tile] = start;
    if tile == tile_total() {
        return;
    }
    let end = start_of(tile + 1u);
    let first = bucket_of(start, tile);
    for (var bucket = first; bucket < bucket_of(end, tile + 1u); bucket++) {
        table[bucket_at(bucket)] = select(NO_TILE, tile, start + (bucket - first) * BUCKET < end);
    }
}
