// Depth, normal and distortion of a pixel, layer by layer: the twin of `TileGeometry` in raster/soft/forward.rs. Needs `step`, `frame`, `geometry`.

struct LayerSums {
    depth: f32,
    normal: vec3<f32>,
    distortion: f32,
    anchor: f32,     // mapped depth of the first layer; the others are relative to it
    sums: vec3<f32>, // of w, w m and w m^2
}

fn add_layer(sums: ptr<function, LayerSums>, weight: f32, inv_depth: f32, normal: vec3<f32>) {
    (*sums).depth += weight / inv_depth;
    (*sums).normal += weight * normal;
    var m = step.depths.x - step.depths.y * inv_depth;
    if (*sums).sums.x <= 0.0 {
        (*sums).anchor = m;
    }
    m -= (*sums).anchor;
    (*sums).distortion += distortion(weight, m, (*sums).sums);
    (*sums).sums += weight * vec3(1.0, m, m * m);
}

// Writes a pixel: the background behind its layers, and their geometry.
fn write_pixel(at: u32, rgb: vec3<f32>, transmittance: f32, sums: LayerSums) {
    frame[at] = vec4(fma(vec3(transmittance), step.background.xyz, rgb), transmittance);
    if GEOMETRY {
        geometry[3u * at] = vec4(sums.normal, sums.depth);
        geometry[3u * at + 1u] = vec4(sums.sums, sums.anchor);
        geometry[3u * at + 2u] = vec4(sums.distortion, 0.0, 0.0, 0.0);
    }
}
