// Draws triangles as an engine does: opaque, double-sided, perspective-correct colours in linear light.
//
// One vertex stage per vertex layout (view/model.rs). `_color` writes only the colour; `_display` also the
// values of other display modes.

struct Frame {
    clip: mat4x4<f32>, // world to clip space: x right, y up, w = depth, z = near
    view: mat4x4<f32>, // world to camera: x right, y down, z forward
}

@group(0) @binding(0) var<uniform> frame: Frame;
@group(1) @binding(0) var<storage, read> face_colors: array<u32>;
// In place of it, for textured triangles.
@group(1) @binding(2) var page: texture_2d<f32>;
@group(1) @binding(3) var trilinear: sampler;

override DISPLAY: u32 = 0u;
const NORMALS: u32 = 1u;
// 1 where the format of the target is not sRGB.
override ENCODE: u32 = 0u;

struct Smooth {
    @builtin(position) clip: vec4<f32>,
    @location(0) color: vec3<f32>,
}
struct Flat {
    @builtin(position) clip: vec4<f32>,
    @location(0) @interpolate(flat) color: vec3<f32>,
}
struct Textured {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
}
struct TexturedDisplay {
    @builtin(position) clip: vec4<f32>,
    @location(0) uv: vec2<f32>,
    @location(1) view: vec3<f32>,
}
struct Displayed {
    @builtin(position) clip: vec4<f32>,
    @location(0) color: vec3<f32>,
    @location(1) view: vec3<f32>,
}

// Linear light of 10 bits per channel, stored as its square root.
fn unpack_color(bits: u32) -> vec3<f32> {
    let root = vec3<f32>(vec3<u32>(bits, bits >> 10u, bits >> 20u) & vec3<u32>(1023u)) / 1023.0;
    return root * root;
}

fn displayed(position: vec3<f32>, color: vec3<f32>) -> Displayed {
    let at = vec4<f32>(position, 1.0);
    return Displayed(frame.clip * at, color, (frame.view * at).xyz);
}

@vertex
fn corner_color(@location(0) position: vec3<f32>, @location(1) root: vec4<f32>) -> Smooth {
    return Smooth(frame.clip * vec4<f32>(position, 1.0), root.rgb * root.rgb);
}

@vertex
fn corner_display(@location(0) position: vec3<f32>, @location(1) root: vec4<f32>) -> Displayed {
    return displayed(position, root.rgb * root.rgb);
}

@vertex
fn face_color(@location(0) position: vec3<f32>, @builtin(vertex_index) vertex: u32) -> Flat {
    return Flat(frame.clip * vec4<f32>(position, 1.0), unpack_color(face_colors[vertex / 3u]));
}

@vertex
fn face_display(@location(0) position: vec3<f32>, @builtin(vertex_index) vertex: u32) -> Displayed {
    return displayed(position, unpack_color(face_colors[vertex / 3u]));
}

@vertex
fn texture_color(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> Textured {
    return Textured(frame.clip * vec4<f32>(position, 1.0), uv);
}

@vertex
fn texture_display(@location(0) position: vec3<f32>, @location(1) uv: vec2<f32>) -> TexturedDisplay {
    let at = vec4<f32>(position, 1.0);
    return TexturedDisplay(frame.clip * at, uv, (frame.view * at).xyz);
}

fn srgb_from_linear(linear: vec3<f32>) -> vec3<f32> {
    let c = clamp(linear, vec3<f32>(0.0), vec3<f32>(1.0));
    return select(1.055 * pow(c, vec3<f32>(1.0 / 2.4)) - 0.055, 12.92 * c, c <= vec3<f32>(0.0031308));
}

fn linear_from_srgb(c: vec3<f32>) -> vec3<f32> {
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
fn flat_light(seen: Flat) -> @location(0) vec4<f32> {
    return written(seen.color);
}

// Towards the viewer; red to the right, green up, blue to the viewer, as `render --show normal`. `view` is a point in the camera's frame.
fn normal_light(view: vec3<f32>) -> vec3<f32> {
    let across = cross(dpdx(view), dpdy(view));
    let normal = across * select(1.0, -1.0, dot(across, view) > 0.0) / max(length(across), 1e-30);
    return linear_from_srgb(0.5 + 0.5 * normal * vec3<f32>(1.0, -1.0, -1.0));
}

@fragment
fn display_light(seen: Displayed) -> @location(0) vec4<f32> {
    if DISPLAY == NORMALS {
        return written(normal_light(seen.view));
    }
    return written(seen.color);
}

@fragment
fn texture_light(seen: Textured) -> @location(0) vec4<f32> {
    return written(textureSample(page, trilinear, seen.uv).rgb);
}

@fragment
fn texture_display_light(seen: TexturedDisplay) -> @location(0) vec4<f32> {
    if DISPLAY == NORMALS {
        return written(normal_light(seen.view));
    }
    return written(textureSample(page, trilinear, seen.uv).rgb);
}
