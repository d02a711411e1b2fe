// Blends the splats of every tile in the order of their depths at each pixel: the twin of `by_pixel` in
// raster/soft/forward.rs. A pixel takes its nearest layers, NEAREST at a time, and walks over all splats of
// the tile for each such group: exact for any number of layers, with one walk for opaque scenes.
//
// Used twice: first to draw and to count the layers of every pixel. When the gradient of the loss is known,
// it writes the layers for the backward pass, with the light in front of each and the sum behind it.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> tile_starts: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> frame: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> geometry: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> layer_starts: array<u32>;
@group(0) @binding(9) var<storage, read_write> layers: array<vec4<f32>>; // place in the pairs, light in front, behind; -
@group(0) @binding(10) var<storage, read> d_frame: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> d_geometry: array<vec4<f32>>;
@group(0) @binding(12) var<uniform> job: Job;

var<workgroup> batch: array<array<vec4<f32>, 4>, BATCH>;
var<workgroup> batch_planes: array<vec4<f32>, BATCH>;
var<workgroup> ended: atomic<u32>;
var<workgroup> all_ended: u32;

// The nearest layers not yet blended, nearest first.
var<private> near_depth: array<f32, NEAREST>; // 1 / z, 0 where there is none
var<private> near_alpha: array<f32, NEAREST>;
var<private> near_pair: array<u32, NEAREST>;

// The pixel so far.
var<private> transmittance: f32;
var<private> rgb: vec3<f32>;
var<private> sums: LayerSums;
var<private> count: u32;
var<private> last_depth: f32; // of the layer that was blended last
var<private> last_pair: u32;
var<private> is_done: bool;
// Where its layers are written: the first place, their number, and the sum behind the last blended one.
var<private> next: u32;
var<private> room: u32;
var<private> behind: f32;

fn insert_layer(inv_depth: f32, alpha: f32, pair: u32) {
    var depth_in = inv_depth;
    var alpha_in = alpha;
    var pair_in = pair;
    for (var k = 0u; k < NEAREST; k++) {
        // Pairs come in the order that breaks ties.
        if near_depth[k] < depth_in {
            let depth_out = near_depth[k];
            let alpha_out = near_alpha[k];
            let pair_out = near_pair[k];
            near_depth[k] = depth_in;
            near_alpha[k] = alpha_in;
            near_pair[k] = pair_in;
            depth_in = depth_out;
            alpha_in = alpha_out;
            pair_in = pair_out;
        }
    }
}

// Puts the layers of a pixel into the order of the pairs.
fn sort_layers(first: u32, end: u32) {
    for (var i = first + 1u; i < end; i++) {
        let layer = layers[i];
        var to = i;
        while to > first && bitcast<u32>(layers[to - 1u].x) > bitcast<u32>(layer.x) {
            layers[to] = layers[to - 1u];
            to -= 1u;
        }
        layers[to] = layer;
    }
}

// Finds the nearest layers that are not yet blended, among the pairs of the tile.
fn find_layers(start: u32, end: u32, pixel: vec2<u32>, local: u32) {
    for (var k = 0u; k < NEAREST; k++) {
        near_depth[k] = 0.0;
    }
    for (var first = start; first < end; first += BATCH) {
        workgroupBarrier();
        if local < BATCH && first + local < end {
            let splat = owners[pairs[first + local]];
            for (var k = 0u; k < 4u; k++) {
                batch[local][k] = records[4u * splat + k];
            }
            batch_planes[local] = planes[2u * splat];
        }
        workgroupBarrier();
        let batch_count = select(min(BATCH, end - first), 0u, is_done);
        for (var i = 0u; i < batch_count; i++) {
            let record = record_of(batch[i][0], batch[i][1], batch[i][2], batch[i][3]);
            let inv_depth = inv_depth_at(batch_planes[i], offset_from(record.origin, pixel));
            let is_behind = inv_depth < last_depth || (inv_depth == last_depth && first + i > last_pair);
            if !is_behind || inv_depth <= near_depth[NEAREST - 1u] {
                continue;
            }
            let s = shade(record, pixel);
            if s.is_drawn {
                insert_layer(inv_depth, s.alpha, first + i);
            }
        }
    }
}

// Writes a layer with the light in front of it and the sum behind it.
fn write_layer(at: u32, k: u32, splat: u32, color: vec3<f32>, before: f32, weight: f32) {
    var value = dot(color, d_frame_of(at).xyz);
    if step.modes.z == 1u {
        value += geometry_value(at, splat, near_depth[k]);
    }
    behind -= weight * value;
    if count < room {
        layers[next + count] = vec4(bitcast<f32>(near_pair[k]), before, behind, 0.0);
    }
}

// Blends the layers that were found.
fn blend_layers(at: u32) {
    for (var k = 0u; k < NEAREST && !is_done; k++) {
        if near_depth[k] == 0.0 {
            is_done = true;
            break;
        }
        let splat = owners[pairs[near_pair[k]]];
        let color = records[4u * splat + 3u].xyz;
        let before = transmittance;
        let blended = blend(before, near_alpha[k]);
        transmittance = blended.y;
        rgb = fma(vec3(blended.x), color, rgb);
        if job.writes == 1u {
            write_layer(at, k, splat, color, before, blended.x);
        } else if step.modes.z == 1u {
            let normal = vec3(planes[2u * splat].w, planes[2u * splat + 1u].xy);
            var added = sums;
            add_layer(&added, blended.x, near_depth[k], normal);
            sums = added;
        }
        count += 1u;
        last_depth = near_depth[k];
        last_pair = near_pair[k];
        is_done = transmittance < step.limits.w;
    }
}

// Blends all layers of all pixels of a tile.
fn blend_tile(start: u32, end: u32, pixel: vec2<u32>, at: u32, local: u32) {
    var is_counted = false;
    if local == 0u {
        atomicStore(&ended, 0u);
        all_ended = 0u;
    }
    loop {
        workgroupBarrier();
        if is_done && !is_counted {
            is_counted = true;
            atomicAdd(&ended, 1u);
        }
        workgroupBarrier();
        if local == 0u && atomicLoad(&ended) == TILE * TILE {
            all_ended = 1u;
        }
        if workgroupUniformLoad(&all_ended) == 1u {
            break;
        }
        find_layers(start, end, pixel, local);
        blend_layers(at);
    }
}

@compute @workgroup_size(TILE, TILE)
fn forward_by_pixel(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_id) place: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = workgroup.y * step.frame.z + workgroup.x;
    let pixel = workgroup.xy * TILE + place.xy;
    let inside = all(pixel < step.frame.xy);
    let at = min(pixel.y, step.frame.y - 1u) * step.frame.x + min(pixel.x, step.frame.x - 1u);
    let start = tile_starts[tile];
    let end = tile_starts[tile + 1u];
    transmittance = select(0.0, 1.0, inside);
    last_depth = 3e38;
    is_done = !inside || start == end;
    if job.writes == 1u && inside {
        next = min(layer_starts[at], arrayLength(&layers));
        room = min(layer_starts[at + 1u], arrayLength(&layers)) - next;
        behind = behind_all(at);
    }
    blend_tile(start, end, pixel, at, local);
    if !inside {
        return;
    }
    if job.writes == 1u {
        sort_layers(next, next + min(count, room));
        return;
    }
    layer_starts[at] = count;
    if at == step.frame.x * step.frame.y - 1u {
        layer_starts[at + 1u] = 0u;
    }
    write_pixel(at, rgb, transmittance, sums);
}
