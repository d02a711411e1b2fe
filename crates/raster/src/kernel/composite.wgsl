// The twin of kernel/composite.rs.

// Weight of a layer and the transmittance behind it.
fn blend(transmittance: f32, alpha: f32) -> vec2<f32> {
    return vec2(transmittance * alpha, transmittance * (1.0 - alpha));
}

fn blend_grad(transmittance: f32, alpha: f32, value: f32, behind: f32, last: bool, background: f32) -> f32 {
    var through = transmittance * background;
    if !last {
        through = behind / (1.0 - alpha);
    }
    return fma(transmittance, value, -through);
}

// w times sum of w_j (m - m_j)^2; sums are those of w, w m and w m^2.
fn distortion(weight: f32, m: f32, sums: vec3<f32>) -> f32 {
    return weight * pair_cost(m, sums);
}

// By w and by m.
fn distortion_grad(weight: f32, m: f32, sums: vec3<f32>) -> vec2<f32> {
    return vec2(pair_cost(m, sums), (weight + weight) * (m * sums.x - sums.y));
}

fn pair_cost(m: f32, sums: vec3<f32>) -> f32 {
    return m * (m * sums.x - sums.y - sums.y) + sums.z;
}
