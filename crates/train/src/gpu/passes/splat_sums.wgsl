// Gradients of a splat, summed over pixels. Needs `step`, shade.wgsl and pixel_grad.wgsl.

// A pixel that the training ignores, among the pixels of a splat: it is drawn, but a million of them count less than one pixel of the photo's mask.
const NOT_COUNTED_PIXEL: f32 = 0x1p-20;

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

// Adds a layer of weight `share.x`, whose gradient by the logarithm of alpha is `share.y`.
fn add_share(sums: ptr<function, SplatSums>, r: Record, pixel: vec2<u32>, d_pixel: vec4<f32>, share: vec2<f32>) {
    let offset = offset_from(r.origin, pixel);
    let ratios = ratios(r.edge0, r.edge1, r.edge2, r.shift, offset);
    var d_edges = vec3(0.0);
    switch WINDOW {
        case WINDOW_SOFT: {
            let ratio = window_ratio(ratios);
            let d = alpha_grad(ratio, log2_lane(ratio), r.sigma, step.edges.y, share.y);
            (*sums).sigma += d.x;
            d_edges = nearest(ratios) * d.y;
        }
        default: { // WINDOW_COVERAGE
            d_edges = coverage_edges(ratios) * (share.y / coverage(ratios));
        }
    }
    (*sums).rgb += share.x * d_pixel.xyz;
    (*sums).opacity += share.y;
    (*sums).ratio += d_edges;
    (*sums).moment_x += d_edges * offset.x;
    (*sums).moment_y += d_edges * offset.y;
    let is_counted = d_pixel.w >= 0.0;
    (*sums).pixels += select(NOT_COUNTED_PIXEL, 1.0, is_counted);
    if is_counted {
        (*sums).error += share.x * d_pixel.w;
        (*sums).max_weight = max((*sums).max_weight, share.x);
        (*sums).sum_weight += share.x;
    }
}

// The part that passes through depth, normal and distortion.
fn add_plane_share(sums: ptr<function, SplatSums>, splat: u32, r: Record, pixel: vec2<u32>, weight: f32) {
    let at = pixel.y * step.frame.x + pixel.x;
    let offset = offset_from(r.origin, pixel);
    let inv_depth = inv_depth_at(planes[2u * splat], offset);
    let d = d_geometry[2u * at];
    let z = 1.0 / inv_depth;
    let by_m = step.depths.y * step.loss.z * distortion_grad_at(at, inv_depth, weight).y;
    let d_inv_depth = -(weight * d.w * z * z) - by_m;
    (*sums).inv_depth += d_inv_depth;
    (*sums).slope += d_inv_depth * offset;
    (*sums).normal += weight * d.xyz;
}

// Two numbers of a slot.
fn slot_vector(sums: SplatSums, at: u32) -> vec2<f32> {
    switch at {
        case 0u: { return sums.rgb.xy; }
        case 1u: { return vec2(sums.rgb.z, sums.opacity); }
        case 2u: { return vec2(sums.sigma, sums.ratio.x); }
        case 3u: { return vec2(sums.moment_x.x, sums.moment_y.x); }
        case 4u: { return vec2(sums.ratio.y, sums.moment_x.y); }
        case 5u: { return vec2(sums.moment_y.y, sums.ratio.z); }
        case 6u: { return vec2(sums.moment_x.z, sums.moment_y.z); }
        case 7u: { return vec2(sums.pixels, sums.error); }
        case 8u: { return vec2(sums.max_weight, sums.sum_weight); }
        case 9u: { return vec2(sums.inv_depth, sums.slope.x); }
        case 10u: { return vec2(sums.slope.y, sums.normal.x); }
        default: { return sums.normal.yz; }
    }
}
