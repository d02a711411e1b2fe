// Areas and opacities of the triangles that are not pinned, summed by workgroup: the twin of `Regularisers` in update.rs.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> x: array<f32>;
@group(0) @binding(2) var<storage, read_write> partial_sums: array<vec4<f32>>;

alias Addend = vec2<f32>;

@compute @workgroup_size(GROUP)
fn regularise(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let group = workgroup_index(workgroup, workgroups);
    let i = group * GROUP + local;
    let n = step.scene.x;
    var value = vec2(0.0);
    if i < n && i >= step.scene.w {
        let v0 = vec3(x[i], x[n + i], x[2u * n + i]);
        let v1 = vec3(x[3u * n + i], x[4u * n + i], x[5u * n + i]);
        let v2 = vec3(x[6u * n + i], x[7u * n + i], x[8u * n + i]);
        let normal = cross(v1 - v0, v2 - v0);
        value = vec2(0.5 * sqrt(dot(normal, normal)), anneal_opacity(x[ROW_OPACITY * n + i]));
    }
    let total = group_sum(local, value);
    if local == 0u && group * GROUP < n {
        partial_sums[group] = vec4(total, 0.0, 0.0);
    }
}
