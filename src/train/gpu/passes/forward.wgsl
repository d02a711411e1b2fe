// Blends the splats of every tile front to back, in the order of the depths of their centroids: the twin of `by_tile` in
// raster/soft/forward.rs. A workgroup is a tile, an invocation a pixel.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> tile_starts: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<u32>;
@group(0) @binding(3) var<storage, read> owners: array<u32>;
@group(0) @binding(4) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> planes: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> frame: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> geometry: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> tile_ends: array<u32>; // no pair from there on shows

var<workgroup> batch: array<array<vec4<f32>, 4>, BATCH>;
var<workgroup> batch_planes: array<array<vec4<f32>, 2>, BATCH>;
var<workgroup> ended: atomic<u32>;
var<workgroup> all_ended: u32;

@compute @workgroup_size(TILE, TILE)
fn forward(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(local_invocation_id) place: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = workgroup.y * step.frame.z + workgroup.x;
    let pixel = workgroup.xy * TILE + place.xy;
    let inside = all(pixel < step.frame.xy);
    let start = tile_starts[tile];
    let end = tile_starts[tile + 1u];
    var transmittance = select(0.0, 1.0, inside);
    var rgb = vec3(0.0);
    var layers: LayerSums;
    if local == 0u {
        atomicStore(&ended, 0u);
        all_ended = 0u;
    }
    var is_counted = false;
    var shown = end;
    for (var first = start; first < end; first += BATCH) {
        workgroupBarrier();
        if local < BATCH && first + local < end {
            let splat = owners[pairs[first + local]];
            for (var k = 0u; k < 4u; k++) {
                batch[local][k] = records[4u * splat + k];
            }
            if step.modes.z == 1u {
                batch_planes[local][0] = planes[2u * splat];
                batch_planes[local][1] = planes[2u * splat + 1u];
            }
        }
        if !is_counted && transmittance < step.limits.w {
            is_counted = true;
            atomicAdd(&ended, 1u);
        }
        workgroupBarrier();
        if local == 0u && atomicLoad(&ended) == TILE * TILE {
            all_ended = 1u;
        }
        if workgroupUniformLoad(&all_ended) == 1u {
            shown = first;
            break;
        }
        let count = min(BATCH, end - first);
        for (var i = 0u; i < count && transmittance >= step.limits.w; i++) {
            let record = record_of(batch[i][0], batch[i][1], batch[i][2], batch[i][3]);
            let s = shade(record, pixel);
            if !s.is_drawn {
                continue;
            }
            let blended = blend(transmittance, s.alpha);
            rgb = fma(vec3(blended.x), record.rgb, rgb);
            if step.modes.z == 1u {
                let plane = batch_planes[i][0];
                let normal = vec3(plane.w, batch_planes[i][1].xy);
                add_layer(&layers, blended.x, inv_depth_at(plane, s.offset), normal);
            }
            transmittance = blended.y;
        }
    }
    if local == 0u {
        tile_ends[tile] = shown;
    }
    if inside {
        write_pixel(pixel.y * step.frame.x + pixel.x, rgb, transmittance, layers);
    }
}
