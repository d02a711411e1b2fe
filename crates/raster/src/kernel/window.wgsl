// The twin of kernel/window.rs (Held et al. 2025, eq. 1).

fn ratios(edge0: vec2<f32>, edge1: vec2<f32>, edge2: vec2<f32>, shift: f32, offset: vec2<f32>) -> vec3<f32> {
    return vec3(dot(edge0, offset), dot(edge1, offset) - shift, dot(edge2, offset));
}

fn window_ratio(r: vec3<f32>) -> f32 {
    return min(min(r.x, r.y), r.z);
}

// 1 for the nearest edge, the first in a tie, 0 for the others.
fn nearest(r: vec3<f32>) -> vec3<f32> {
    if r.x <= r.y && r.x <= r.z {
        return vec3(1.0, 0.0, 0.0);
    }
    if r.y <= r.z {
        return vec3(0.0, 1.0, 0.0);
    }
    return vec3(0.0, 0.0, 1.0);
}

fn ratio_floor(log2_opacity: f32, sigma: f32, log2_cutoff: f32) -> f32 {
    return max(exp2_lane(max((log2_cutoff - log2_opacity) / sigma, -30.0)), RATIO_FLOOR);
}

fn window_alpha(log2_ratio: f32, log2_opacity: f32, sigma: f32) -> f32 {
    return exp2_lane(clamp(fma(sigma, log2_ratio, log2_opacity), -126.0, 1.0));
}

// dL/dsigma and dL/dratio.
fn alpha_grad(ratio: f32, log2_ratio: f32, sigma: f32, min_ratio: f32, d_log: f32) -> vec2<f32> {
    return vec2(d_log * log2_ratio * LN_2, d_log * sigma / max(ratio, min_ratio));
}

fn coverage(distances: vec3<f32>) -> f32 {
    let outside = max(vec3(0.5) - distances, vec3(0.0));
    return 1.0 - outside.x - outside.y - outside.z;
}

// 1 for the edges that cut the pixel.
fn coverage_edges(distances: vec3<f32>) -> vec3<f32> {
    return select(vec3(0.0), vec3(1.0), distances < vec3(0.5));
}
