// The twins of math/lanes/poly.rs and math/color.rs. Constants come from Rust: math/wgsl.rs.

// False for infinities and NaN, which comparisons do not detect on every card.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

// For positive normal numbers.
fn log2_lane(x: f32) -> f32 {
    let bits = bitcast<i32>(x);
    let exponent = (bits - SQRT_HALF_BITS) >> 23u;
    let t = bitcast<f32>(bits - (exponent << 23u)) - 1.0;
    var p = fma(LOG2[7], t, LOG2[6]);
    p = fma(p, t, LOG2[5]);
    p = fma(p, t, LOG2[4]);
    p = fma(p, t, LOG2[3]);
    p = fma(p, t, LOG2[2]);
    p = fma(p, t, LOG2[1]);
    p = fma(p, t, LOG2[0]);
    return fma(p, t, f32(exponent));
}

// On [-126, 126].
fn exp2_lane(x: f32) -> f32 {
    let whole = round(x);
    let f = x - whole;
    var p = fma(EXP2[5], f, EXP2[4]);
    p = fma(p, f, EXP2[3]);
    p = fma(p, f, EXP2[2]);
    p = fma(p, f, EXP2[1]);
    p = fma(p, f, EXP2[0]);
    return bitcast<f32>(bitcast<u32>(p) + (bitcast<u32>(i32(whole)) << 23u));
}

// e to the power of x, clamped to the range of exp2_lane.
fn exp_lane(x: f32) -> f32 {
    return exp2_lane(clamp(x / LN_2, -126.0, 126.0));
}

fn linear_from_srgb(encoded: f32) -> f32 {
    return decode(clamp(encoded, 0.0, 1.0)).x;
}

fn srgb_from_linear(linear: f32) -> f32 {
    return encode(clamp(linear, 0.0, 1.0)).x;
}

// The linear light of an encoded channel >= 0, and its slope there.
fn decode(encoded: f32) -> vec2<f32> {
    let base = (max(encoded, 0.04045) + 0.055) * (1.0 / 1.055);
    let linear = exp2_lane(log2_lane(base) * 2.4);
    if encoded <= 0.04045 {
        return vec2(encoded * (1.0 / 12.92), 1.0 / 12.92);
    }
    return vec2(linear, linear / base * (2.4 / 1.055));
}

// The sRGB encoding of a linear channel >= 0, and its slope there.
fn encode(linear: f32) -> vec2<f32> {
    let light = max(linear, 0.0031308);
    let power = exp2_lane(log2_lane(light) * (1.0 / 2.4)) * 1.055;
    if linear <= 0.0031308 {
        return vec2(linear * 12.92, 12.92);
    }
    return vec2(power - 0.055, power / light * (1.0 / 2.4));
}
