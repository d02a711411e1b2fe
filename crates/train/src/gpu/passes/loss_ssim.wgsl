// SSIM of every value, and its derivatives by the blurred maps: the twin of kernel/ssim.rs. A workgroup
// handles a square of TILE x TILE pixels with REACH more on each side; channel by channel the rows are
// blurred, then the columns.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> picture: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> photo: array<u32>;
@group(0) @binding(3) var<storage, read_write> maps: array<f32>; // by mean, square and cross; each for three channels
@group(0) @binding(4) var<storage, read_write> partial_sums: array<vec4<f32>>;

alias Addend = vec2<f32>;

const SIDE: u32 = TILE + 2u * REACH;

var<workgroup> values: array<vec2<f32>, SIDE * SIDE>; // picture, photo
var<workgroup> means: array<vec2<f32>, SIDE * TILE>;
var<workgroup> squares: array<vec2<f32>, SIDE * TILE>; // x^2 + y^2, xy

fn value_at(pixel: vec2<i32>, channel: u32) -> vec2<f32> {
    if any(pixel < vec2(0)) || any(pixel >= vec2<i32>(step.frame.xy)) {
        return vec2(0.0);
    }
    let at = u32(pixel.y) * step.frame.x + u32(pixel.x);
    return vec2(picture[2u * at][channel], photo_rgb(at)[channel]);
}

@compute @workgroup_size(TILE, TILE)
fn loss_ssim(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_id) place: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let pixel = workgroup.xy * TILE + place.xy;
    let corner = vec2<i32>(workgroup.xy * TILE) - i32(REACH);
    let inside = all(pixel < step.frame.xy);
    let at = pixel.y * step.frame.x + pixel.x;
    let count = step.frame.x * step.frame.y;
    var sum = 0.0;
    for (var channel = 0u; channel < 3u; channel++) {
        workgroupBarrier();
        for (var i = local; i < SIDE * SIDE; i += TILE * TILE) {
            values[i] = value_at(corner + vec2<i32>(vec2(i % SIDE, i / SIDE)), channel);
        }
        workgroupBarrier();
        for (var i = local; i < SIDE * TILE; i += TILE * TILE) {
            var mean = vec2(0.0);
            var square = vec2(0.0);
            for (var k = 0u; k < 2u * REACH + 1u; k++) {
                let v = values[i / TILE * SIDE + i % TILE + k];
                // Fused like the CPU's: in pale pictures the variances are small differences, so roundings show.
                mean = fma(vec2(SSIM_WINDOW[k]), v, mean);
                square = fma(vec2(SSIM_WINDOW[k]), vec2(v.x * v.x + v.y * v.y, v.x * v.y), square);
            }
            means[i] = mean;
            squares[i] = square;
        }
        workgroupBarrier();
        if inside {
            var mean = vec2(0.0);
            var square = vec2(0.0);
            for (var k = 0u; k < 2u * REACH + 1u; k++) {
                let i = (place.y + k) * TILE + place.x;
                mean = fma(vec2(SSIM_WINDOW[k]), means[i], mean);
                square = fma(vec2(SSIM_WINDOW[k]), squares[i], square);
            }
            let weight = photo_weight(at);
            let s = ssim_grad(mean.x, mean.y, square.x, square.y, step.loss.y);
            sum += weight * s.value;
            maps[channel * count + at] = weight * s.d_mean;
            maps[(3u + channel) * count + at] = weight * s.d_square;
            maps[(6u + channel) * count + at] = weight * s.d_cross;
        }
    }
    let total = group_sum(local, vec2(sum, 0.0));
    if local == 0u {
        partial_sums[workgroup.y * workgroups.x + workgroup.x] = vec4(0.0, 0.0, total.x, 0.0);
    }
}
