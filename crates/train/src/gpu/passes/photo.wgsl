// The photo, one u32 per pixel: the lowest three bytes hold the colour, the highest byte the weight. Needs `step`, `photo`.

fn photo_rgb(at: u32) -> vec3<f32> {
    let bits = photo[at];
    return vec3<f32>(vec3(bits & 255u, (bits >> 8u) & 255u, (bits >> 16u) & 255u)) * (1.0 / 255.0);
}

fn photo_weight(at: u32) -> f32 {
    return f32(photo[at] >> 24u) * (1.0 / 255.0);
}
