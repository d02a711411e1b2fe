// Areas of the triangles that are not pinned, summed by workgroup: the twin of `Regularisers` in update.rs.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read_write> partial_sums: array<vec4<f32>>;

alias Addend = f32;

@compute @workgroup_size(GROUP)
fn regularise(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    // A chunk begins with a group.
    let group = chunk.first / GROUP + workgroup_index(workgroup, workgroups);
    let i = group * GROUP + local;
    let end = chunk.first + chunk.count;
    var value = 0.0;
    if i < end && i >= step.scene.w {
        let v0 = corner_of(i, 0u);
        let normal = cross(corner_of(i, 1u) - v0, corner_of(i, 2u) - v0);
        value = 0.5 * sqrt(dot(normal, normal));
    }
    let total = group_sum(local, value);
    if local == 0u && group * GROUP < end {
        partial_sums[group] = vec4(total, 0.0, 0.0, 0.0);
    }
}
