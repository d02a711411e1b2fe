// Gradients of the splats of every bucket: the twin of raster/soft/backward.rs. A workgroup is a bucket, which begins with the
// colour and the light that the forward pass kept. With losses on geometry one workgroup handles all buckets of a tile, because
// more would have to be kept.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> table: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read> d_frame: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read> d_geometry: array<vec4<f32>>;

// The pixel in front of the next splat: the light, and the sum of w dL/dw of all splats behind.
var<private> transmittance: f32;
var<private> behind: f32;
var<private> background: f32;

// The share of a splat on the pixel.
fn next_share(k: u32, place: u32, pixel: vec2<u32>, local: u32) -> vec2<f32> {
    let before = transmittance;
    let record = record_of(batch[k][0], batch[k][1], batch[k][2], batch[k][3]);
    let s = shade(record, pixel);
    if before < step.limits.w || !s.is_drawn {
        return vec2(-1.0, 0.0);
    }
    let blended = blend(before, s.alpha);
    var value = dot(record.rgb, d_pixels[local].xyz);
    if GEOMETRY {
        let splat = batch_splats[k];
        let at = pixel.y * step.frame.x + pixel.x;
        value += geometry_value(at, splat, inv_depth_at(planes[2u * splat], s.offset));
    }
    behind -= blended.x * value;
    transmittance = blended.y;
    return vec2(blended.x, layer_share(s, background, before, behind, value));
}

// The pixel in front of bucket `number` of a tile that begins at `start`.
fn begin_pixel(start: u32, number: u32, pixel: vec2<u32>, local: u32) {
    d_pixels[local] = vec4(0.0);
    if !all(pixel < step.frame.xy) {
        return;
    }
    let at = pixel.y * step.frame.x + pixel.x;
    let d_pixel = d_frame[at];
    d_pixels[local] = d_pixel;
    background = d_background(at);
    transmittance = 1.0;
    behind = behind_all(at);
    if number > 0u {
        let kept = frame[checkpoint_at(start, number) + local];
        transmittance = kept.w;
        behind -= dot(d_pixel.xyz, kept.xyz);
    }
}

@compute @workgroup_size(GROUP)
fn backward(
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
    let number = bucket - bucket_of(start, tile);
    if GEOMETRY && number > 0u {
        return;
    }
    let first = start + number * BUCKET;
    let end = min(table[tile + 1u], select(first + BUCKET, 0xffffffffu, GEOMETRY));
    let shown = clamp(table[shown_at(tile)], first, end);
    let corner = vec2(tile % step.frame.z, tile / step.frame.z) * TILE;
    if first < shown {
        begin_pixel(start, number, corner + pixel_in_tile(local), local);
    }
    sum_pairs(first, shown, corner, local);
    // Nothing of what lies behind shows.
    write_nothing(shown, end, local);
}
