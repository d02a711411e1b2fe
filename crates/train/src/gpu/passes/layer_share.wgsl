// A layer's share of the gradient on a pixel: the twin of `add_grad` in raster/soft/backward.rs. Needs `step`.

// The gradient by the logarithm of alpha. `before` is the light in front of the layer; `behind` the sum of w dL/dw behind it.
fn layer_share(s: Shade, background: f32, before: f32, behind: f32, value: f32) -> f32 {
    let is_last = blend(before, s.alpha).y < step.limits.w;
    let d_alpha = blend_grad(before, s.alpha, value, behind, is_last, background);
    return select(0.0, d_alpha * s.raw, s.raw <= step.limits.z);
}
