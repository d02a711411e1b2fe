// Pairs of splats and tiles, each with the blocks that the splat may touch: the twin of raster/soft/tiles.rs.
// Counts the tiles of each splat, and later emits them at the places from the scan of the counts. One pass does both,
// so that both find the same pairs.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> job: Job;
@group(0) @binding(2) var<storage, read> counts: array<u32>;
@group(0) @binding(3) var<storage, read> order: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> bounds: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> pair_starts: array<u32>;
@group(0) @binding(7) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(8) var<storage, read_write> owners: array<vec2<u32>>; // splat, blocks

// Tiles with a pixel centre in [lo, hi]: the first, and one past the last.
fn tiles_between(lo: f32, hi: f32, size: f32) -> vec2<u32> {
    let first = max(ceil(lo - 0.5 - MARGIN), 0.0);
    let last = min(floor(hi - 0.5 + MARGIN), size - 1.0);
    if !(first <= last) {
        return vec2(0u, 0u);
    }
    return vec2(u32(first) / TILE, u32(last) / TILE + 1u);
}

// The least and the largest ratio to an edge at the pixel centres of the tile at `offset` from the origin; `constant` is that of the
// ratio minus the floor.
fn reach(edge: vec2<f32>, constant: f32, offset: vec2<f32>) -> vec2<f32> {
    let middle = dot(edge, offset + f32(TILE) * 0.5) + constant;
    let half = HALF_TILE * (abs(edge.x) + abs(edge.y));
    return vec2(middle - half, middle + half);
}

// Blocks of a tile that are not wholly outside the edge or the box; box and `offset` are relative to the tile's corner and the origin.
fn blocks_inside(edge: vec2<f32>, constant: f32, offset: vec2<f32>) -> u32 {
    let half = HALF_BLOCK * (abs(edge.x) + abs(edge.y)) + constant;
    var blocks = 0u;
    for (var block = 0u; block < 16u; block++) {
        let middle = vec2<f32>(vec2(block % 4u, block / 4u) * 4u + 2u);
        blocks |= select(0u, 1u << block, dot(edge, offset + middle) + half >= 0.0);
    }
    return blocks;
}

// Columns (0x1111) or rows (0x000f) of blocks that overlap [lo, hi].
fn blocks_between(lo: f32, hi: f32, first: u32, stride: u32) -> u32 {
    var blocks = 0u;
    for (var k = 0u; k < 4u; k++) {
        let middle = f32(4u * k + 2u);
        blocks |= select(0u, first << (stride * k), lo - HALF_BLOCK <= middle && middle <= hi + HALF_BLOCK);
    }
    return blocks;
}

// The blocks of the tile at `corner` that the splat may touch: a separating axis shows a gap to the others.
fn blocks_touched(a: vec4<f32>, b: vec4<f32>, shift: f32, floor: f32, box: vec4<f32>, corner: vec2<f32>) -> u32 {
    let offset = corner - a.xy;
    let reach0 = reach(a.zw, -floor, offset);
    let reach1 = reach(b.xy, -floor - shift, offset);
    let reach2 = reach(b.zw, -floor, offset);
    if min(min(reach0.y, reach1.y), reach2.y) < 0.0 {
        return 0u;
    }
    var blocks = blocks_between(box.x - corner.x, box.z - corner.x, 0x1111u, 1u);
    blocks &= blocks_between(box.y - corner.y, box.w - corner.y, 0xfu, 4u);
    if min(min(reach0.x, reach1.x), reach2.x) < 0.0 {
        blocks &= blocks_inside(a.zw, -floor, offset);
        blocks &= blocks_inside(b.xy, -floor - shift, offset);
        blocks &= blocks_inside(b.zw, -floor, offset);
    }
    return blocks;
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
            let blocks = blocks_touched(a, b, c.x, floor, box, vec2(f32(tx * TILE), f32(ty * TILE)));
            if blocks != 0u {
                if job.writes == 0u {
                    count += 1u;
                } else if next < end {
                    tiles[next] = ty * step.frame.z + tx;
                    owners[next] = vec2(splat, blocks);
                    next += 1u;
                }
            }
        }
    }
    if job.writes == 0u {
        pair_starts[rank] = count;
    }
}
