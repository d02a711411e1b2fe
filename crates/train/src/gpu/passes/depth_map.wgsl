// The depth map behind the normal consistency: the twin of `Maps` in kernel/normal.rs. Needs `step`, `frame`.

fn coverage_of(at: u32) -> f32 {
    return 1.0 - frame[at].w;
}

fn ray_of(at: u32) -> vec3<f32> {
    let pixel = vec2<f32>(vec2(at % step.frame.x, at / step.frame.x)) + 0.5;
    return vec3((pixel - step.lens.zw) / step.lens.xy, 1.0);
}
