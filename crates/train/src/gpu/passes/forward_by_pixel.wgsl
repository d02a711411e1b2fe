// Blends the splats of every tile in the order of their depths at each pixel: the twin of `by_pixel` in
// raster/soft/forward.rs. A pixel takes its nearest layers, NEAREST at a time, and walks over all splats of
// the tile for each such group: exact for any number of layers, with one walk for opaque scenes.
//
// Used twice: first to draw, to count the layers of every pixel and to keep the first of them. When the gradient of the loss is
// known, it writes the layers and their shares for the backward pass; tiles whose pixels have kept all need no further walk.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> frame: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> geometry: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> layer_starts: array<u32>;
@group(0) @binding(9) var<storage, read_write> layers: array<vec4<f32>>; // place in the pairs, weight, gradient by the logarithm of alpha; -
@group(0) @binding(10) var<storage, read> d_frame: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> d_geometry: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> kept: array<vec4<u32>>; // places of each pixel's first NEAREST layers
@group(0) @binding(13) var<uniform> job: Job;

const NEEDS_PLANES: bool = true;

var<workgroup> ended: atomic<u32>;

// The nearest layers not yet blended, nearest first.
var<private> near_depth: array<f32, NEAREST>; // 1 / z, 0 where there is none
var<private> near_alpha: array<f32, NEAREST>;
var<private> near_pair: array<u32, NEAREST>;
// 1 / z of the nearest layer that hides everything behind it, 0 where there is none.
var<private> hidden_depth: f32;

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
    hidden_depth = 0.0;
    for (var first = start; first < end; first += BATCH) {
        workgroupBarrier();
        load_batch(first, end, local);
        workgroupBarrier();
        fill_queues(local);
        workgroupBarrier();
        for (var half = 0u; half < 2u; half++) {
            var queue = select(atomicLoad(&queues[local / 16u][half]), 0u, is_done);
            while queue != 0u {
                find_layer(32u * half + firstTrailingBit(queue), first, pixel);
                queue &= queue - 1u;
            }
        }
    }
}

// One splat of the batch that begins at `first`.
fn find_layer(k: u32, first: u32, pixel: vec2<u32>) {
    let record = record_of(batch[k][0], batch[k][1], batch[k][2], batch[k][3]);
    let inv_depth = inv_depth_at(batch_planes[k][0], offset_from(record.origin, pixel));
    let is_behind = inv_depth < last_depth || (inv_depth == last_depth && first + k > last_pair);
    if !is_behind || inv_depth <= near_depth[NEAREST - 1u] || inv_depth < hidden_depth {
        return;
    }
    let s = shade(record, pixel);
    if s.is_drawn {
        insert_layer(inv_depth, s.alpha, first + k);
        if 1.0 - s.alpha < step.limits.w {
            hidden_depth = max(hidden_depth, inv_depth);
        }
    }
}

// Writes a layer with its share.
fn write_layer(at: u32, pixel: vec2<u32>, place: u32, splat: u32) {
    let first = 4u * splat;
    let record = record_of(records[first], records[first + 1u], records[first + 2u], records[first + 3u]);
    let s = shade(record, pixel);
    var value = dot(record.rgb, d_frame[at].xyz);
    if GEOMETRY {
        value += geometry_value(at, splat, inv_depth_at(planes[2u * splat], s.offset));
    }
    let blended = blend(transmittance, s.alpha);
    behind -= blended.x * value;
    if count < room {
        let share = layer_share(s, d_background(at), transmittance, behind, value);
        layers[next + count] = vec4(bitcast<f32>(place), blended.x, share, 0.0);
    }
    transmittance = blended.y;
}

// Draws a layer that was found.
fn draw_layer(k: u32, splat: u32) {
    let blended = blend(transmittance, near_alpha[k]);
    transmittance = blended.y;
    rgb = fma(vec3(blended.x), records[4u * splat + 3u].xyz, rgb);
    if GEOMETRY {
        let normal = vec3(planes[2u * splat].w, planes[2u * splat + 1u].xy);
        var added = sums;
        add_layer(&added, blended.x, near_depth[k], normal);
        sums = added;
    }
}

// Blends the layers that were found.
fn blend_layers(at: u32, pixel: vec2<u32>) {
    for (var k = 0u; k < NEAREST && !is_done; k++) {
        if near_depth[k] == 0.0 {
            is_done = true;
            break;
        }
        let splat = owners[pairs[near_pair[k]]].x;
        if job.writes == 1u {
            write_layer(at, pixel, near_pair[k], splat);
        } else {
            draw_layer(k, splat);
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
    }
    var is_first = true;
    loop {
        workgroupBarrier();
        if is_done && !is_counted {
            is_counted = true;
            atomicAdd(&ended, 1u);
        }
        workgroupBarrier();
        if atomicLoad(&ended) == GROUP {
            break;
        }
        find_layers(start, end, pixel, local);
        if is_first && job.writes == 0u && !is_done {
            keep_layers(at);
        }
        is_first = false;
        blend_layers(at, pixel);
    }
}

// Keeps the places of the layers that were found first, if they are needed later.
fn keep_layers(at: u32) {
    if 2u * at + 1u < arrayLength(&kept) {
        kept[2u * at] = vec4(near_pair[0], near_pair[1], near_pair[2], near_pair[3]);
        kept[2u * at + 1u] = vec4(near_pair[4], near_pair[5], near_pair[6], near_pair[7]);
    }
}

// Writes the layers of a pixel that has kept them all.
fn write_kept(at: u32, pixel: vec2<u32>) {
    for (; count < room; count++) {
        let place = kept[2u * at + count / 4u][count % 4u];
        write_layer(at, pixel, place, owners[pairs[place]].x);
    }
}

// Whether some pixel of the tile has more layers than it kept.
fn has_more(local: u32) -> bool {
    if local == 0u {
        atomicStore(&ended, 0u);
    }
    workgroupBarrier();
    if room > NEAREST {
        atomicOr(&ended, 1u);
    }
    workgroupBarrier();
    let found = atomicLoad(&ended) != 0u;
    workgroupBarrier();
    return found;
}

@compute @workgroup_size(GROUP)
fn forward_by_pixel(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = workgroup.y * step.frame.z + workgroup.x;
    let pixel = workgroup.xy * TILE + pixel_in_tile(local);
    let inside = all(pixel < step.frame.xy);
    let at = min(pixel.y, step.frame.y - 1u) * step.frame.x + min(pixel.x, step.frame.x - 1u);
    let start = table[tile];
    let end = table[tile + 1u];
    transmittance = select(0.0, 1.0, inside);
    last_depth = 3e38;
    is_done = !inside || start == end;
    if job.writes == 1u && inside {
        next = min(layer_starts[at], arrayLength(&layers));
        room = min(layer_starts[at + 1u], arrayLength(&layers)) - next;
        behind = behind_all(at);
    }
    if job.writes == 0u || has_more(local) {
        blend_tile(start, end, pixel, at, local);
    } else if inside {
        write_kept(at, pixel);
    }
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
