// The gradient of the loss by a pixel. Needs `step`, `geometry`, `planes`, `d_frame` (by the colour, and the squared
// error, which is negative where the training ignores the pixel) and `d_geometry` (by the normal and the depth, then by
// the transmittance).

// By the transmittance behind the last layer.
fn d_background(at: u32) -> f32 {
    var out = dot(d_frame[at].xyz, step.background.xyz);
    if GEOMETRY {
        out += d_geometry[2u * at + 1u].x;
    }
    return out;
}

// Distortion by w and by m of a layer.
fn distortion_grad_at(at: u32, inv_depth: f32, weight: f32) -> vec2<f32> {
    let sums = geometry[3u * at + 1u];
    let m = step.depths.x - step.depths.y * inv_depth - sums.w;
    return distortion_grad(weight, m, sums.xyz);
}

// The part of dL/dw that comes from depth, normal and distortion.
fn geometry_value(at: u32, splat: u32, inv_depth: f32) -> f32 {
    let d = d_geometry[2u * at];
    let normal = vec3(planes[2u * splat].w, planes[2u * splat + 1u].xy);
    return d.w / inv_depth + dot(d.xyz, normal) + step.loss.z * distortion_grad_at(at, inv_depth, 0.0).x;
}
