// Depth, normal and distortion of a pixel, layer by layer: the twin of `TileGeometry` in raster/soft/forward.rs. Needs `step`.

struct LayerSums {
    depth: f32,
    normal: vec3<f32>,
    distortion: f32,
    anchor: f32,     // mapped depth of the first layer; the others are taken relative to it
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
