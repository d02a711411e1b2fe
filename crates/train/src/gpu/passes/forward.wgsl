// Blends the splats of every tile front to back, in the order of the depths of their centroids: the twin of `by_tile` in
// raster/soft/forward.rs. A workgroup is a tile, an invocation a pixel, which passes over the splats that cannot touch its block.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> table: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<vec2<u32>>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> frame: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> geometry: array<vec4<f32>>;

const NEEDS_PLANES: bool = GEOMETRY;

var<workgroup> ended: atomic<u32>;

// The pixel so far.
var<private> transmittance: f32;
var<private> rgb: vec3<f32>;
var<private> layers: LayerSums;

fn blend_splat(k: u32, pixel: vec2<u32>) {
    let record = record_of(batch[k][0], batch[k][1], batch[k][2], batch[k][3]);
    let s = shade(record, pixel);
    if !s.is_drawn {
        return;
    }
    let blended = blend(transmittance, s.alpha);
    rgb = fma(vec3(blended.x), record.rgb, rgb);
    if GEOMETRY {
        let plane = batch_planes[k][0];
        let normal = vec3(plane.w, batch_planes[k][1].xy);
        var added = layers;
        add_layer(&added, blended.x, inv_depth_at(plane, s.offset), normal);
        layers = added;
    }
    transmittance = blended.y;
}

@compute @workgroup_size(GROUP)
fn forward(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = workgroup.y * step.frame.z + workgroup.x;
    let pixel = workgroup.xy * TILE + pixel_in_tile(local);
    let inside = all(pixel < step.frame.xy);
    let start = table[tile];
    let end = table[tile + 1u];
    transmittance = select(0.0, 1.0, inside);
    if local == 0u {
        atomicStore(&ended, 0u);
    }
    var is_counted = false;
    var shown = end;
    for (var first = start; first < end; first += BATCH) {
        workgroupBarrier();
        if !is_counted && transmittance < step.limits.w {
            is_counted = true;
            atomicAdd(&ended, 1u);
        }
        load_batch(first, end, local);
        workgroupBarrier();
        if atomicLoad(&ended) == GROUP {
            shown = first;
            break;
        }
        fill_queues(local);
        let bucket = (first - start) / BUCKET;
        if (first - start) % BUCKET == 0u && bucket > 0u {
            let at = checkpoint_at(start, bucket) + local;
            if at < arrayLength(&frame) {
                frame[at] = vec4(rgb, transmittance);
            }
        }
        workgroupBarrier();
        for (var half = 0u; half < 2u; half++) {
            var queue = atomicLoad(&queues[local / 16u][half]);
            while queue != 0u && transmittance >= step.limits.w {
                blend_splat(32u * half + firstTrailingBit(queue), pixel);
                queue &= queue - 1u;
            }
        }
    }
    if local == 0u {
        table[shown_at(tile)] = shown;
    }
    if inside {
        write_pixel(pixel.y * step.frame.x + pixel.x, rgb, transmittance, layers);
    }
}
