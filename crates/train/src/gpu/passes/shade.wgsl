// A splat's contribution to a pixel: the twin of raster/soft/layers.rs. Needs `step`.

struct Record {
    origin: vec2<f32>,
    edge0: vec2<f32>,
    edge1: vec2<f32>,
    edge2: vec2<f32>,
    shift: f32,
    floor: f32,
    sigma: f32,
    log2_opacity: f32,
    rgb: vec3<f32>,
}

struct Shade {
    offset: vec2<f32>,   // p - origin, px
    ratios: vec3<f32>,
    ratio: f32,          // the ratio or the coverage
    log2_ratio: f32,
    raw: f32,            // alpha before the cap
    alpha: f32,
    is_drawn: bool,
}

fn record_of(a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32>) -> Record {
    return Record(a.xy, a.zw, b.xy, b.zw, c.x, c.y, c.z, c.w, d.xyz);
}

// p - origin, summed as on the CPU: in blocks of four pixels.
fn offset_from(origin: vec2<f32>, pixel: vec2<u32>) -> vec2<f32> {
    return vec2<f32>(pixel & vec2(3u)) + (vec2<f32>(pixel & vec2(~3u)) + 0.5 - origin);
}

fn shade(r: Record, pixel: vec2<u32>) -> Shade {
    var out: Shade;
    out.offset = offset_from(r.origin, pixel);
    out.ratios = ratios(r.edge0, r.edge1, r.edge2, r.shift, out.offset);
    if WINDOW == WINDOW_COVERAGE {
        out.ratio = coverage(out.ratios);
    } else {
        out.ratio = window_ratio(out.ratios);
    }
    out.is_drawn = r.floor <= out.ratio;
    out.log2_ratio = 0.0;
    out.raw = 0.0;
    out.alpha = 0.0;
    if !out.is_drawn {
        return out;
    }
    switch WINDOW {
        case WINDOW_SOFT: {
            out.log2_ratio = log2_lane(out.ratio);
            out.raw = window_alpha(out.log2_ratio, r.log2_opacity, r.sigma);
        }
        default: { // WINDOW_COVERAGE
            out.raw = exp2_lane(r.log2_opacity) * out.ratio;
        }
    }
    out.alpha = min(out.raw, step.limits.z);
    return out;
}

// 1 / z at `offset` from the origin.
fn inv_depth_at(plane: vec4<f32>, offset: vec2<f32>) -> f32 {
    return max(fma(plane.z, offset.y, fma(plane.y, offset.x, plane.x)), 1e-20);
}
