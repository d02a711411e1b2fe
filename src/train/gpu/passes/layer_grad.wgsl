// Gradient of a layer on a pixel: the twin of `add_grad` in raster/soft/backward.rs. Needs `step`, pixel_grad.wgsl and put_slot.wgsl.

struct SplatSums {
    rgb: vec3<f32>,
    opacity: f32,
    sigma: f32,
    ratio: vec3<f32>,
    moment_x: vec3<f32>,
    moment_y: vec3<f32>,
    pixels: f32,
    error: f32,
    max_weight: f32,
    sum_weight: f32,
    inv_depth: f32,
    slope: vec2<f32>,
    normal: vec3<f32>,
}

// `before` is the light in front of the layer; `behind` the sum of w dL/dw behind it.
fn add_layer_grad(
    sums: ptr<function, SplatSums>,
    s: Shade,
    sigma: f32,
    d_pixel: vec4<f32>,
    background: f32,
    before: f32,
    behind: f32,
    value: f32,
) {
    let blended = blend(before, s.alpha);
    let d_alpha = blend_grad(before, s.alpha, value, behind, blended.y < step.limits.w, background);
    let d_log = select(0.0, d_alpha * s.raw, s.raw <= step.limits.z);
    var d_ratio = 0.0;
    var edges = vec3(0.0);
    switch step.modes.x {
        case WINDOW_SOFT: {
            let d = alpha_grad(s.ratio, s.log2_ratio, sigma, step.edges.y, d_log);
            (*sums).sigma += d.x;
            d_ratio = d.y;
            edges = nearest(s.ratios);
        }
        case WINDOW_COVERAGE: {
            d_ratio = d_log / s.ratio;
            edges = coverage_edges(s.ratios);
        }
        default: {
            let d = sigmoid_grad(s.ratio, sigma, d_log);
            (*sums).sigma += d.x;
            d_ratio = d.y;
            edges = nearest(s.ratios);
        }
    }
    let weight = blended.x;
    (*sums).rgb += weight * d_pixel.xyz;
    (*sums).error += weight * d_pixel.w;
    (*sums).opacity += d_log;
    let d_edges = edges * d_ratio;
    (*sums).ratio += d_edges;
    (*sums).moment_x += d_edges * s.offset.x;
    (*sums).moment_y += d_edges * s.offset.y;
    (*sums).pixels += 1.0;
    (*sums).max_weight = max((*sums).max_weight, weight);
    (*sums).sum_weight += weight;
}

// The part that passes through depth, normal and distortion.
fn add_plane_grad(sums: ptr<function, SplatSums>, at: u32, offset: vec2<f32>, inv_depth: f32, weight: f32) {
    let d = d_geometry[2u * at];
    let z = 1.0 / inv_depth;
    let by_m = step.depths.y * step.loss.z * distortion_grad_at(at, inv_depth, weight).y;
    let d_inv_depth = -(weight * d.w * z * z) - by_m;
    (*sums).inv_depth += d_inv_depth;
    (*sums).slope += d_inv_depth * offset;
    (*sums).normal += weight * d.xyz;
}

fn write_slot(at: u32, sums: SplatSums) {
    let part = slot_part(at);
    let first = (at - part * step.parts.w) * step.modes.w;
    put_slot(part, first + RGB, sums.rgb.x);
    put_slot(part, first + RGB + 1u, sums.rgb.y);
    put_slot(part, first + RGB + 2u, sums.rgb.z);
    put_slot(part, first + OPACITY, sums.opacity);
    put_slot(part, first + SIGMA, sums.sigma);
    for (var i = 0u; i < 3u; i++) {
        put_slot(part, first + RATIO + 3u * i, sums.ratio[i]);
        put_slot(part, first + RATIO + 3u * i + 1u, sums.moment_x[i]);
        put_slot(part, first + RATIO + 3u * i + 2u, sums.moment_y[i]);
    }
    put_slot(part, first + PIXELS, sums.pixels);
    put_slot(part, first + ERROR, sums.error);
    put_slot(part, first + MAX_WEIGHT, sums.max_weight);
    put_slot(part, first + SUM_WEIGHT, sums.sum_weight);
    if step.modes.z == 1u {
        put_slot(part, first + GEOMETRY, sums.inv_depth);
        put_slot(part, first + GEOMETRY + 1u, sums.slope.x);
        put_slot(part, first + GEOMETRY + 2u, sums.slope.y);
        put_slot(part, first + GEOMETRY + 3u, sums.normal.x);
        put_slot(part, first + GEOMETRY + 4u, sums.normal.y);
        put_slot(part, first + GEOMETRY + 5u, sums.normal.z);
    }
}

// The record of a splat. Needs `records`.
fn record_at(splat: u32) -> Record {
    let at = 4u * splat;
    return record_of(records[at], records[at + 1u], records[at + 2u], records[at + 3u]);
}
