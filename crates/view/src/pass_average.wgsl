// Averages N x N samples per pixel in linear light, as engines resolve supersampling.

@group(0) @binding(0) var samples: texture_2d<f32>;
override PER_AXIS: u32 = 1u;

@vertex
fn whole_screen(@builtin(vertex_index) vertex: u32) -> @builtin(position) vec4<f32> {
    return vec4<f32>(select(-1.0, 3.0, vertex == 1u), select(-1.0, 3.0, vertex == 2u), 0.0, 1.0);
}

@fragment
fn average(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let first = vec2<u32>(at.xy) * PER_AXIS;
    var sum = vec3<f32>(0.0);
    for (var y = 0u; y < PER_AXIS; y++) {
        for (var x = 0u; x < PER_AXIS; x++) {
            sum += textureLoad(samples, first + vec2<u32>(x, y), 0).rgb;
        }
    }
    return vec4<f32>(sum / f32(PER_AXIS * PER_AXIS), 1.0);
}
