// Second of two passes of the normal consistency: by depth and by transmittance, from the slopes of the neighbours.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> geometry: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> d_geometry: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> slopes: array<vec4<f32>>;

@compute @workgroup_size(GROUP)
fn normal_grad(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = workgroup_index(workgroup, workgroups) * GROUP + local;
    let width = step.frame.x;
    let count = width * step.frame.y;
    if at >= count {
        return;
    }
    var d_depth = 0.0;
    var d_transmittance = 0.0;
    let covered = coverage_of(at);
    if MIN_COVERAGE < covered {
        // A pixel is the right neighbour of the previous pixel and the left neighbour of the next.
        var d_point = vec3(0.0);
        if at >= 1u {
            d_point += slopes[2u * (at - 1u)].xyz;
        }
        if at + 1u < count {
            d_point -= slopes[2u * (at + 1u)].xyz;
        }
        if at >= width {
            d_point += slopes[2u * (at - width) + 1u].xyz;
        }
        if at + width < count {
            d_point -= slopes[2u * (at + width) + 1u].xyz;
        }
        d_depth = dot(d_point, ray_of(at)) / covered;
        d_transmittance = d_depth * geometry[3u * at].w / covered;
    }
    d_geometry[2u * at].w = d_depth;
    d_geometry[2u * at + 1u] = vec4(d_transmittance, 0.0, 0.0, 0.0);
}
