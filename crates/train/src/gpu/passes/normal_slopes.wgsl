// First of two passes of the normal consistency, and the mean distortion: the twin of `pixel` in kernel/normal.rs, by
// frame pixels. Writes the gradient of the normals, and that of the slopes of the depth map.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> d_geometry: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> slopes: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> partial_sums: array<vec4<f32>>;

alias Addend = f32;

struct Agreement {
    loss: f32,
    d_normal: vec3<f32>,
    d_across: vec3<f32>,
    d_down: vec3<f32>,
}

fn point_of(at: u32) -> vec3<f32> {
    return ray_of(at) * (geometry[3u * at].w / coverage_of(at));
}

fn agreement(at: u32) -> Agreement {
    var out: Agreement;
    let width = step.frame.x;
    let x = at % width;
    let y = at / width;
    let scale = step.loss.w;
    if scale == 0.0 || x == 0u || y == 0u || x + 1u >= width || y + 1u >= step.frame.y {
        return out;
    }
    let around = min(min(coverage_of(at - 1u), coverage_of(at + 1u)), min(coverage_of(at - width), coverage_of(at + width)));
    if !(MIN_COVERAGE < min(around, coverage_of(at))) {
        return out;
    }
    let across = point_of(at + 1u) - point_of(at - 1u);
    let down = point_of(at + width) - point_of(at - width);
    let normal = cross(across, down);
    let length = sqrt(dot(normal, normal));
    if !(1e-20 < length) {
        return out;
    }
    let n = geometry[3u * at].xyz;
    let surface = -normal / length;
    let weight = scale * coverage_of(at);
    let agrees = dot(n, surface);
    let d_cross = (n - surface * agrees) * (weight / length);
    out.loss = weight * (1.0 - agrees);
    out.d_normal = -surface * weight;
    out.d_across = cross(down, d_cross);
    out.d_down = cross(d_cross, across);
    return out;
}

@compute @workgroup_size(GROUP)
fn normal_slopes(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let group = workgroup_index(workgroup, workgroups);
    let at = group * GROUP + local;
    let count = step.frame.x * step.frame.y;
    var loss = 0.0;
    if at < count {
        let found = agreement(at);
        slopes[2u * at] = vec4(found.d_across, 0.0);
        slopes[2u * at + 1u] = vec4(found.d_down, 0.0);
        d_geometry[2u * at] = vec4(found.d_normal, 0.0);
        loss = found.loss + step.loss.z * geometry[3u * at + 2u].x;
    }
    let total = group_sum(local, loss);
    if local == 0u && group * GROUP < count {
        partial_sums[group] = vec4(total, 0.0, 0.0, 0.0);
    }
}
