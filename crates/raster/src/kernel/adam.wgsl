// The twin of kernel/adam.rs.

struct Adam {
    value: f32,
    first: f32,
    second: f32,
}

// `rate` and `second_scale` are the fields of `Rate`.
fn adam(rate: f32, second_scale: f32, gradient: f32, x: Adam) -> Adam {
    let m = BETA1 * x.first + (1.0 - BETA1) * gradient;
    let v = BETA2 * x.second + (1.0 - BETA2) * gradient * gradient;
    return Adam(x.value - rate * m / (sqrt(v * second_scale) + EPS), m, v);
}
