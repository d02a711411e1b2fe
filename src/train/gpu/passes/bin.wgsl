// Pairs of splats and tiles: the twin of raster/soft/tiles.rs. Counts the tiles of each splat, and later
// emits them at the places from the scan of the counts. One pass does both, so that both find the same pairs.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> job: Job;
@group(0) @binding(2) var<storage, read> counts: array<u32>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> bounds: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> pair_starts: array<u32>;
@group(0) @binding(7) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(8) var<storage, read_write> owners: array<u32>;

// Tiles with a pixel centre in [lo, hi]: the first, and one past the last.
fn tiles_between(lo: f32, hi: f32, size: f32) -> vec2<u32> {
    let first = max(ceil(lo - 0.5 - MARGIN), 0.0);
    let last = min(floor(hi - 0.5 + MARGIN), size - 1.0);
    if !(first <= last) {
        return vec2(0u, 0u);
    }
    return vec2(u32(first) / TILE, u32(last) / TILE + 1u);
}

// Whether the tile is not wholly outside an edge: `constant` is the ratio's constant minus the floor.
fn touches(edge: vec2<f32>, constant: f32, offset: vec2<f32>) -> bool {
    let reach = HALF_TILE * (abs(edge.x) + abs(edge.y)) + constant;
    return dot(edge, offset + f32(TILE) * 0.5) + reach >= 0.0;
}

@compute @workgroup_size(GROUP)
fn bin(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let rank = workgroup_index(workgroup, workgroups) * GROUP + local;
    let splats = counts[SPLATS];
    if rank >= splats {
        if rank == splats && job.writes == 0u {
            pair_starts[rank] = 0u;
        }
        return;
    }
    var next = 0u;
    var end = 0u;
    if job.writes == 1u {
        next = pair_starts[rank];
        end = min(pair_starts[rank + 1u], counts[PAIRS]);
    }
    let splat = order[rank];
    let a = records[4u * splat];
    let b = records[4u * splat + 1u];
    let c = records[4u * splat + 2u];
    let box = bounds[splat];
    // Where the splat is drawn, every edge is at least this far above the floor.
    let floor = c.y - select(0.0, 0.5, step.modes.x == WINDOW_COVERAGE);
    let across = tiles_between(box.x, box.z, f32(step.frame.x));
    let down = tiles_between(box.y, box.w, f32(step.frame.y));
    var count = 0u;
    for (var ty = down.x; ty < down.y; ty++) {
        for (var tx = across.x; tx < across.y; tx++) {
            let offset = vec2(f32(tx * TILE), f32(ty * TILE)) - a.xy;
            if touches(a.zw, -floor, offset) && touches(b.xy, -floor - c.x, offset) && touches(b.zw, -floor, offset) {
                if job.writes == 0u {
                    count += 1u;
                } else if next < end {
                    tiles[next] = ty * step.frame.z + tx;
                    owners[next] = splat;
                    next += 1u;
                }
            }
        }
    }
    if job.writes == 0u {
        pair_starts[rank] = count;
    }
}
