// The gradient of the whole loss, from the blurred derivatives of SSIM and the difference; and each pixel's
// error. The twin of kernel/loss.rs and frame_loss.rs.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> picture: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read> maps: array<f32>;
@group(0) @binding(4) var<storage, read_write> partial_sums: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> d_frame: array<vec4<f32>>;

alias Addend = vec2<f32>;

// In place of the error of a pixel that the training ignores.
const NOT_COUNTED: f32 = -1.0;
const SIDE: u32 = TILE + 2u * REACH;

var<workgroup> values: array<vec3<f32>, SIDE * SIDE>;
var<workgroup> rows: array<vec3<f32>, SIDE * TILE>;

fn maps_at(pixel: vec2<i32>, channel: u32) -> vec3<f32> {
    if any(pixel < vec2(0)) || any(pixel >= vec2<i32>(step.frame.xy)) {
        return vec3(0.0);
    }
    let count = step.frame.x * step.frame.y;
    let at = channel * count + u32(pixel.y) * step.frame.x + u32(pixel.x);
    return vec3(maps[at], maps[at + 3u * count], maps[at + 6u * count]);
}

@compute @workgroup_size(TILE, TILE)
fn loss_grad(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_id) place: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = workgroup.xy * TILE + place.xy;
    let corner = vec2<i32>(workgroup.xy * TILE) - i32(REACH);
    let inside = all(pixel < step.frame.xy);
    let at = min(pixel.y, step.frame.y - 1u) * step.frame.x + min(pixel.x, step.frame.x - 1u);
    let x = picture[2u * at].xyz;
    let y = photo_rgb(at);
    let weight = select(0.0, photo_weight(at), inside);
    let difference = x - y;
    var d = weight * step.loss.x * sign(difference);
    for (var channel = 0u; channel < 3u; channel++) {
        workgroupBarrier();
        for (var i = local; i < SIDE * SIDE; i += TILE * TILE) {
            values[i] = maps_at(corner + vec2<i32>(vec2(i % SIDE, i / SIDE)), channel);
        }
        workgroupBarrier();
        for (var i = local; i < SIDE * TILE; i += TILE * TILE) {
            var row = vec3(0.0);
            for (var k = 0u; k < 2u * REACH + 1u; k++) {
                row += SSIM_WINDOW[k] * values[i / TILE * SIDE + i % TILE + k];
            }
            rows[i] = row;
        }
        workgroupBarrier();
        var blurred = vec3(0.0);
        for (var k = 0u; k < 2u * REACH + 1u; k++) {
            blurred += SSIM_WINDOW[k] * rows[(place.y + k) * TILE + place.x];
        }
        d[channel] += blurred.x + 2.0 * x[channel] * blurred.y + y[channel] * blurred.z;
    }
    let error = dot(difference, difference);
    if inside {
        d_frame[at] = vec4(d * picture[2u * at + 1u].xyz, select(NOT_COUNTED, weight * error, weight > 0.0));
    }
    let absolute = abs(difference);
    let total = group_sum(local, weight * vec2(absolute.x + absolute.y + absolute.z, error));
    if local == 0u {
        let group = workgroup.y * workgroups.x + workgroup.x;
        partial_sums[group] = vec4(total, partial_sums[group].zw);
    }
}
