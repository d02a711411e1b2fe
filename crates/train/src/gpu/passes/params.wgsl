// Raw parameters and their physical values: the twin of params.rs. Needs `step`, the part of the scene as
// `chunk`, and its rows `x`.

// The place of number `number` of triangle i.
fn row_at(number: u32, i: u32) -> u32 {
    return number * chunk.count + (i - chunk.first);
}

fn corner_of(i: u32, corner: u32) -> vec3<f32> {
    return vec3(x[row_at(3u * corner, i)], x[row_at(3u * corner + 1u, i)], x[row_at(3u * corner + 2u, i)]);
}

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

// The opacity and σ that triangle i is drawn with: the twin of `activate` in cpu.rs.

fn drawn_opacity(i: u32) -> f32 {
    let raw = x[row_at(ROW_OPACITY, i)];
    if step.anneal.w == 1.0 {
        return raw;
    }
    if i >= step.parts.x {
        return anneal_opacity(raw);
    }
    let opacity = sigmoid(raw);
    if step.parts.y == 0u {
        return opacity;
    }
    let sigma = drawn_sigma(i);
    return opacity * (2.0 / ((sigma + 1.0) * (sigma + 2.0)));
}

fn drawn_sigma(i: u32) -> f32 {
    let raw = x[row_at(ROW_SIGMA, i)];
    if step.anneal.w == 1.0 {
        return raw;
    }
    if i >= step.parts.x {
        return anneal_sigma(raw);
    }
    return max(SIGMA_MIN + exp_lane(raw), SIGMA_SOLID);
}
