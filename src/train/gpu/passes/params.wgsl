// Raw parameters and what they stand for: the twin of params.rs. Needs `step`, and the rows `x` as read.

fn sigmoid(x: f32) -> f32 {
    return 1.0 / (1.0 + exp_lane(-x));
}

fn anneal_opacity(raw: f32) -> f32 {
    return step.anneal.x + (1.0 - step.anneal.x) * sigmoid(step.anneal.y * raw);
}

fn anneal_opacity_grad(raw: f32, d_opacity: f32) -> f32 {
    let s = sigmoid(step.anneal.y * raw);
    return d_opacity * (1.0 - step.anneal.x) * step.anneal.y * s * (1.0 - s);
}

fn anneal_sigma(raw: f32) -> f32 {
    return max(step.anneal.z * (SIGMA_MIN + exp_lane(raw)), SIGMA_SOLID);
}

fn anneal_sigma_grad(raw: f32, d_sigma: f32) -> f32 {
    return d_sigma * step.anneal.z * exp_lane(raw);
}
