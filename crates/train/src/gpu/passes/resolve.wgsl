// The picture for the comparison with the photo, sRGB-encoded, and the slope of the encoding. The twin of `Encode` in cpu.rs.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read> frame: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> picture: array<vec4<f32>>; // colour, then slope

@compute @workgroup_size(GROUP)
fn resolve(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = workgroup_index(workgroup, workgroups) * GROUP + local;
    if at >= step.frame.x * step.frame.y {
        return;
    }
    var rgb = frame[at].xyz;
    var slope = vec3(1.0);
    if step.edges.w == 1.0 {
        let r = encode(rgb.x);
        let g = encode(rgb.y);
        let b = encode(rgb.z);
        rgb = vec3(r.x, g.x, b.x);
        slope = vec3(r.y, g.y, b.y);
    }
    picture[2u * at] = vec4(rgb, 0.0);
    picture[2u * at + 1u] = vec4(slope, 0.0);
}
