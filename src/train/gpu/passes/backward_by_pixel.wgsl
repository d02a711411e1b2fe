// Like backward.wgsl, for pixels with their own order of layers. A pixel's list, sorted by splat, stores the
// light in front of each layer and the sum behind it; the pixels pass with their place in the list.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> tile_starts: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> d_frame: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> d_geometry: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> layer_starts: array<u32>;
@group(0) @binding(10) var<storage, read> layers: array<vec4<f32>>;

// For every pixel, the next layer in its list, and the end of the list.
var<workgroup> state: array<vec2<u32>, TILE * TILE>;

// The splat of `place` among the pairs on pixel `p` of the tile.
fn pass_pixel(sums: ptr<function, SplatSums>, place: u32, splat: u32, record: Record, corner: vec2<u32>, p: u32) {
    if state[p].x >= state[p].y {
        return;
    }
    let layer = layers[state[p].x];
    if bitcast<u32>(layer.x) != place {
        return;
    }
    state[p].x += 1u;
    let pixel = corner + vec2(p % TILE, p / TILE);
    let at = pixel.y * step.frame.x + pixel.x;
    let s = shade(record, pixel);
    let d_pixel = d_frame_of(at);
    var value = dot(record.rgb, d_pixel.xyz);
    if step.modes.z == 1u {
        let inv_depth = inv_depth_at(planes[2u * splat], s.offset);
        value += geometry_value(at, splat, inv_depth);
        add_plane_grad(sums, at, s.offset, inv_depth, layer.y * s.alpha);
    }
    add_layer_grad(sums, s, record.sigma, d_pixel, d_background(at), layer.y, layer.z, value);
}

@compute @workgroup_size(TURNS)
fn backward_by_pixel(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = workgroup.y * step.frame.z + workgroup.x;
    let corner = workgroup.xy * TILE;
    let start = tile_starts[tile];
    let end = tile_starts[tile + 1u];
    for (var p = local; p < TILE * TILE; p += TURNS) {
        let pixel = corner + vec2(p % TILE, p / TILE);
        state[p] = vec2(0u);
        if all(pixel < step.frame.xy) {
            let at = pixel.y * step.frame.x + pixel.x;
            state[p] = min(vec2(layer_starts[at], layer_starts[at + 1u]), vec2(arrayLength(&layers)));
        }
    }
    for (var first = start; first < end; first += TURNS) {
        var sums: SplatSums;
        let has_splat = first + local < end;
        let pair = pairs[min(first + local, end - 1u)];
        let splat = owners[pair];
        let record = record_at(splat);
        for (var turn = 0u; turn < TILE * TILE + TURNS - 1u; turn++) {
            workgroupBarrier();
            let p = turn - local;
            if has_splat && p < TILE * TILE {
                pass_pixel(&sums, first + local, splat, record, corner, p);
            }
        }
        if has_splat {
            write_slot(pair, sums);
        }
    }
}
