// The sum behind the first layer of a pixel. Needs `frame`, and the bindings of pixel_grad.wgsl.

// The sum of w dL/dw over all layers, the background included.
fn behind_all(at: u32) -> f32 {
    let drawn = frame[at];
    var total = dot(d_frame[at].xyz, drawn.xyz);
    if GEOMETRY {
        let d = d_geometry[2u * at];
        let g = geometry[3u * at];
        total += d_geometry[2u * at + 1u].x * drawn.w + dot(d, g);
        total += 2.0 * geometry[3u * at + 2u].x * step.loss.z;
    }
    return total;
}
