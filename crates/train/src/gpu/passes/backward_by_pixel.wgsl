// Like backward.wgsl, for pixels with their own order of layers. A pixel's list, in the order of the pairs, has the shares of its
// layers.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> d_frame: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read> d_geometry: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> layer_starts: array<u32>;
@group(0) @binding(14) var<storage, read> layers: array<vec4<f32>>;

// The pixel's next layer, and the end of its list.
var<private> next_layer: u32;
var<private> end_layer: u32;
// The place of the next layer's splat among the pairs.
var<private> next_place: u32;

fn find_place() {
    next_place = 0xffffffffu;
    if next_layer < end_layer {
        next_place = bitcast<u32>(layers[next_layer].x);
    }
}

// The share of the splat of `place` among the pairs on the pixel.
fn next_share(k: u32, place: u32, pixel: vec2<u32>, local: u32) -> vec2<f32> {
    if next_place != place {
        return vec2(-1.0, 0.0);
    }
    let layer = layers[next_layer];
    next_layer += 1u;
    find_place();
    return layer.yz;
}

// The pixel's list from the pair at `first` on.
fn begin_pixel(first: u32, pixel: vec2<u32>, local: u32) {
    d_pixels[local] = vec4(0.0);
    if all(pixel < step.frame.xy) {
        let at = pixel.y * step.frame.x + pixel.x;
        d_pixels[local] = d_frame[at];
        next_layer = min(layer_starts[at], arrayLength(&layers));
        end_layer = min(layer_starts[at + 1u], arrayLength(&layers));
    }
    find_place();
    while next_place < first {
        next_layer += 1u;
        find_place();
    }
}

@compute @workgroup_size(GROUP)
fn backward_by_pixel(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let bucket = workgroup_index(workgroup, workgroups);
    let tile = tile_of_bucket(bucket);
    if tile == NO_TILE {
        return;
    }
    let start = table[tile];
    let first = start + (bucket - bucket_of(start, tile)) * BUCKET;
    let end = min(table[tile + 1u], first + BUCKET);
    let corner = vec2(tile % step.frame.z, tile / step.frame.z) * TILE;
    begin_pixel(first, corner + pixel_in_tile(local), local);
    sum_pairs(first, end, corner, local);
}
