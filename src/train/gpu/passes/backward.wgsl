// Sums of the pixels' gradients for every pair of a splat and a tile, without atomics: the twin of raster/soft/backward.rs.
//
// A workgroup handles a tile, an invocation one splat of a batch. The pixels pass through the invocations: in
// turn t invocation i works on pixel t - i, after invocation i - 1 did so in the previous turn. So every
// pixel meets the splats front to back, every splat meets the pixels in order, and the sums stay with the
// splat.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> tile_starts: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> d_frame: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> d_geometry: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> tile_ends: array<u32>;

var<workgroup> d_pixels: array<vec4<f32>, TILE * TILE>;
var<workgroup> backgrounds: array<f32, TILE * TILE>;
// For every pixel, in front of the next splat: the light, and the sum of w dL/dw of all splats behind.
var<workgroup> state: array<vec2<f32>, TILE * TILE>;

// One splat on pixel `p` of the tile.
fn pass_pixel(sums: ptr<function, SplatSums>, splat: u32, record: Record, corner: vec2<u32>, p: u32) {
    let before = state[p].x;
    if before < step.limits.w {
        return;
    }
    let pixel = corner + vec2(p % TILE, p / TILE);
    let s = shade(record, pixel);
    if !s.is_drawn {
        return;
    }
    let blended = blend(before, s.alpha);
    let at = pixel.y * step.frame.x + pixel.x;
    var value = dot(record.rgb, d_pixels[p].xyz);
    if step.modes.z == 1u {
        let inv_depth = inv_depth_at(planes[2u * splat], s.offset);
        value += geometry_value(at, splat, inv_depth);
        add_plane_grad(sums, at, s.offset, inv_depth, blended.x);
    }
    let behind = state[p].y - blended.x * value;
    state[p] = vec2(blended.y, behind);
    add_layer_grad(sums, s, record.sigma, d_pixels[p], backgrounds[p], before, behind, value);
}

@compute @workgroup_size(TURNS)
fn backward(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = workgroup.y * step.frame.z + workgroup.x;
    let corner = workgroup.xy * TILE;
    let start = tile_starts[tile];
    let end = tile_starts[tile + 1u];
    for (var p = local; p < TILE * TILE; p += TURNS) {
        let pixel = corner + vec2(p % TILE, p / TILE);
        state[p] = vec2(0.0);
        if all(pixel < step.frame.xy) {
            let at = pixel.y * step.frame.x + pixel.x;
            d_pixels[p] = d_frame_of(at);
            backgrounds[p] = d_background(at);
            state[p] = vec2(1.0, behind_all(at));
        }
    }
    let shown = tile_ends[tile];
    for (var first = start; first < shown; first += TURNS) {
        var sums: SplatSums;
        let has_splat = first + local < shown;
        let pair = pairs[min(first + local, shown - 1u)];
        let splat = owners[pair];
        let record = record_at(splat);
        for (var turn = 0u; turn < TILE * TILE + TURNS - 1u; turn++) {
            workgroupBarrier();
            let p = turn - local;
            if has_splat && p < TILE * TILE {
                pass_pixel(&sums, splat, record, corner, p);
            }
        }
        if has_splat {
            write_slot(pair, sums);
        }
    }
    // Nothing of what lies behind shows.
    var nothing: SplatSums;
    for (var i = shown + local; i < end; i += TURNS) {
        write_slot(pairs[i], nothing);
    }
}
