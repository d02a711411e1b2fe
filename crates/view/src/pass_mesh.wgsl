// Draws triangles as an engine does: opaque, perspective-correct colours in linear light.
//
// One vertex stage per kind of corner (view/model.rs). `sh_basis` is that of kernel/sh.wgsl.

struct Frame {
    clip: mat4x4<f32>, // world to clip space: x right, y up, w = depth, z = near
    eye: vec4<f32>,    // the camera's place; w = degree of the spherical harmonics
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(1) @binding(0) var page: texture_2d<f32>;
@group(1) @binding(1) var trilinear: sampler;
// Red, green and blue of each coefficient, face by face.
@group(1) @binding(2) var<storage, read> harmonics: array<f32>;

// 1 where the format of the target is not sRGB.
override ENCODE: u32 = 0u;

struct Smooth {
    @builtin(position) clip: vec4<f32>,
    @location(0) color: vec3<f32>,
}
struct Textured {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
}

@vertex
fn corner_color(@location(0) position: vec3<f32>, @location(1) root: vec4<f32>) -> Smooth {
    return Smooth(frame.clip * vec4<f32>(position, 1.0), root.rgb * root.rgb);
}

@vertex
fn harmonic_color(
    @builtin(vertex_index) vertex: u32,
    @location(0) position: vec3<f32>,
    @location(1) root: vec4<f32>,
) -> Smooth {
    let degree = u32(frame.eye.w);
    let width = (degree + 1u) * (degree + 1u);
    let first = vertex / 3u * width * 3u;
    var basis = sh_basis(degree, normalize(position - frame.eye.xyz));
    var code = srgb_from_linear(root.rgb * root.rgb);
    for (var j = 0u; j < width; j++) {
        let at = first + 3u * j;
        code += basis[j] * vec3<f32>(harmonics[at], harmonics[at + 1u], harmonics[at + 2u]);
    }
    return Smooth(frame.clip * vec4<f32>(position, 1.0), linear_from_srgb(code));
}

@vertex
fn texture_color(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Textured {
    return Textured(frame.clip * vec4<f32>(position, 1.0), uv);
}

fn srgb_from_linear(linear: vec3<f32>) -> vec3<f32> {
    let c = clamp(linear, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(1.055 * pow(c, vec3<f32>(1.0 / 2.4)) - 0.055, 12.92 * c, c <= vec3<f32>(0.0031308));
}

fn linear_from_srgb(encoded: vec3<f32>) -> vec3<f32> {
    let c = clamp(encoded, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(pow((c + 0.055) / 1.055, vec3<f32>(2.4)), c / 12.92, c <= vec3<f32>(0.04045));
}

fn written(linear: vec3<f32>) -> vec4<f32> {
    if ENCODE == 1u {
        return vec4<f32>(srgb_from_linear(linear), 1.0);
    }
    return vec4<f32>(linear, 1.0);
}

@fragment
fn smooth_light(seen: Smooth) -> @location(0) vec4<f32> {
    return written(seen.color);
}

@fragment
fn texture_light(seen: Textured) -> @location(0) vec4<f32> {
    return written(textureSample(page, trilinear, seen.uv).rgb);
}
