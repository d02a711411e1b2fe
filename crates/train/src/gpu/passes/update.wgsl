// Chain rules, regularisers and Adam of every triangle, and its visibility: the twin of
// raster/soft/gather.rs and of update.rs. No gradient is ever stored.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<storage, read_write> counts: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read> splat_starts: array<u32>;
@group(0) @binding(3) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> pieces: array<u32>;
@group(0) @binding(5) var<storage, read> sums: array<f32>;
@group(0) @binding(6) var<storage, read_write> x: array<f32>;
@group(0) @binding(7) var<storage, read_write> first_moments: array<f32>;
@group(0) @binding(8) var<storage, read_write> second_moments: array<f32>;
@group(0) @binding(9) var<storage, read_write> visibility: array<u32>;
@group(0) @binding(10) var<uniform> chunk: Chunk;

struct TriangleGrad {
    vertices: array<vec3<f32>, 3>,
    opacity: f32,
    sigma: f32,
    rgb: vec3<f32>,
    error: f32,
    pixels: f32,
    max_weight: f32,
    sum_weight: f32,
    radius_px: f32,
    nearness: f32,
}

fn sum_of(splat: u32, number: u32) -> f32 {
    return sums[splat * step.modes.w + number];
}

// The gradient of a piece's corners in camera space.
fn corner_grad(splat_index: u32, corners: CameraTriangle, splat: Splat) -> CameraTriangle {
    let by_fade = fade_grad(splat.inradius, step.edges.x) / fade(splat.inradius, step.edges.x);
    var scale = 1.0;
    var by_inradius = by_fade;
    var by_incenter = 1.0;
    // Distances from the edges are ratios times an inradius, in which a constant inradius cancels.
    if step.modes.x == WINDOW_COVERAGE {
        scale = splat.inradius / step.edges.z;
        by_inradius = 0.0;
        by_incenter = 0.0;
    }
    var d: SplatGrad;
    for (var i = 0u; i < 3u; i++) {
        let at = RATIO + 3u * i;
        d.ratio[i] = sum_of(splat_index, at) * scale;
        d.moment[i] = vec2(sum_of(splat_index, at + 1u), sum_of(splat_index, at + 2u)) * scale;
    }
    d.inradius = sum_of(splat_index, OPACITY) * by_inradius;
    d.by_incenter = by_incenter;
    var out = splat_grad(corners, step.lens.xy, splat, d);
    if step.modes.z == 1u {
        var by_plane: DepthPlane;
        by_plane.inv_depth = sum_of(splat_index, PLANE);
        by_plane.slope = vec2(sum_of(splat_index, PLANE + 1u), sum_of(splat_index, PLANE + 2u));
        by_plane.normal = vec3(
            sum_of(splat_index, PLANE + 3u),
            sum_of(splat_index, PLANE + 4u),
            sum_of(splat_index, PLANE + 5u),
        );
        let plane = depth_plane(corners, step.lens.xy);
        let more = depth_plane_grad(corners, step.lens.xy, splat, plane, by_plane);
        out.first += more.first;
        out.edge1 += more.edge1;
        out.edge2 += more.edge2;
    }
    return out;
}

fn radius(splat: Splat) -> f32 {
    let centroid = (splat.side1 + splat.side2) * (1.0 / 3.0);
    return max(max(length2(centroid), length2(splat.side1 - centroid)), length2(splat.side2 - centroid));
}

fn add_piece(out: ptr<function, TriangleGrad>, splat_index: u32, whole: CameraTriangle, opacity: f32) {
    let piece = pieces[splat_index];
    let corners = clipped(whole, piece);
    // Nothing here depends on where the principal point is.
    let splat = project_splat(corners, step.lens.xy, vec2(0.0));
    (*out).radius_px = max((*out).radius_px, radius(splat));
    let pixels = sum_of(splat_index, PIXELS);
    if pixels == 0.0 {
        return;
    }
    (*out).pixels += pixels;
    (*out).nearness = max((*out).nearness, 1.0 / (corners.first.z + (corners.edge1.z + corners.edge2.z) * (1.0 / 3.0)));
    (*out).max_weight = max((*out).max_weight, sum_of(splat_index, MAX_WEIGHT));
    (*out).sum_weight += sum_of(splat_index, SUM_WEIGHT);
    (*out).rgb += vec3(sum_of(splat_index, RGB), sum_of(splat_index, RGB + 1u), sum_of(splat_index, RGB + 2u));
    (*out).opacity += sum_of(splat_index, OPACITY) / opacity;
    (*out).sigma += sum_of(splat_index, SIGMA);
    (*out).error += sum_of(splat_index, ERROR);
    let d = corner_grad(splat_index, corners, splat);
    var each = array<vec3<f32>, 3>(d.first - d.edge1 - d.edge2, d.edge1, d.edge2);
    for (var k = 0u; k < 3u; k++) {
        let front = front_corner(piece, k);
        let back = back_corner(piece, k);
        if front == back {
            (*out).vertices[front] += rotate_back(each[k]);
        } else {
            let both = near_point_grad(camera_corner(whole, front), camera_corner(whole, back), step.position.w, each[k]);
            (*out).vertices[front] += rotate_back(both.front);
            (*out).vertices[back] += rotate_back(both.back);
        }
    }
}

// The gradient of the colour before the clamp at 0, where only one that raises the colour passes, and in linear light before the
// decoding.
fn raw_color_grad(d: vec3<f32>, rgb: vec3<f32>) -> vec3<f32> {
    var out = select(vec3(0.0), d, (rgb > vec3(0.0)) | (d < vec3(0.0)));
    if step.edges.w == 1.0 {
        out *= vec3(
            decode(srgb_from_linear(rgb.x)).y,
            decode(srgb_from_linear(rgb.y)).y,
            decode(srgb_from_linear(rgb.z)).y,
        );
    }
    return out;
}

fn is_finite3(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

fn move_number(number: u32, i: u32, rate: f32, gradient: f32) {
    let at = row_at(number, i);
    let moved = adam(rate, step.update.y, gradient, Adam(x[at], first_moments[at], second_moments[at]));
    x[at] = moved.value;
    first_moments[at] = moved.first;
    second_moments[at] = moved.second;
}

// The gradient of beta / mean area by the corners.
fn area_grad(t: WorldTriangle, d_area: f32) -> array<vec3<f32>, 3> {
    let e1 = t.v1 - t.v0;
    let e2 = t.v2 - t.v0;
    let n = cross(e1, e2);
    let length = sqrt(dot(n, n));
    if !(length > 0.0 && is_finite(1.0 / length)) {
        return array<vec3<f32>, 3>(vec3(0.0), vec3(0.0), vec3(0.0));
    }
    let normal = n / length * (0.5 * d_area);
    let d1 = cross(e2, normal);
    let d2 = cross(normal, e1);
    return array<vec3<f32>, 3>(-(d1 + d2), d1, d2);
}

fn mean_of(place: u32, least: f32) -> f32 {
    let n = max(f32(step.scene.x - step.scene.w), 1.0);
    return max(bitcast<f32>(atomicLoad(&counts[place])) / n, least);
}

fn record_visibility(i: u32, d: TriangleGrad, is_finite_grad: bool) {
    let n = step.scene.x;
    // All are at least 0, so their bits have the same order.
    visibility[i] = max(visibility[i], bitcast<u32>(d.max_weight));
    visibility[n + i] = max(visibility[n + i], bitcast<u32>(d.radius_px));
    if d.pixels >= 2.0 {
        visibility[6u * n + i] = max(visibility[6u * n + i], bitcast<u32>(d.nearness));
    }
    if step.update.w == 1.0 {
        visibility[2u * n + i] += select(0u, 1u, d.pixels >= 2.0);
        visibility[5u * n + i] = bitcast<u32>(bitcast<f32>(visibility[5u * n + i]) + d.sum_weight);
    }
    if is_finite_grad {
        // 64-bit integers in two halves; for a product beyond them, or a NaN, the sum is undefined on every
        // machine.
        let units = clamp(d.error * ERROR_UNITS, 0.0, 1e18);
        let high = floor(units / 4294967296.0);
        let low = u32(units - high * 4294967296.0);
        let sum = visibility[3u * n + i] + low;
        visibility[4u * n + i] += u32(high) + select(0u, 1u, sum < low);
        visibility[3u * n + i] = sum;
    }
}

fn triangle_of(i: u32) -> WorldTriangle {
    return WorldTriangle(corner_of(i, 0u), corner_of(i, 1u), corner_of(i, 2u));
}

// Coefficients in use.
fn used_sh() -> u32 {
    return (step.scene.z + 1u) * (step.scene.z + 1u);
}

// The basis in the direction of a drawn triangle.
var<private> basis: array<f32, 16>;

// The corners' gradient through the colour: moving a triangle changes its viewing direction.
fn view_grad(i: u32, view: vec4<f32>, d_rgb: vec3<f32>) -> vec3<f32> {
    if step.scene.z == 0u || !(view.w > 0.0) {
        return vec3(0.0);
    }
    let n = chunk.count;
    var d_basis: array<f32, 16>;
    for (var k = 0u; k < used_sh(); k++) {
        let at = row_at(ROW_SH + 3u * k, i);
        d_basis[k] = dot(vec3(x[at], x[at + n], x[at + 2u * n]), d_rgb);
    }
    return normalize_grad(view.xyz, view.w, sh_basis_grad(step.scene.z, view.xyz, d_basis)) * (1.0 / 3.0);
}

fn is_finite_grad(d: TriangleGrad) -> bool {
    return is_finite3(d.rgb) && is_finite3(d.vertices[0]) && is_finite3(d.vertices[1]) && is_finite3(d.vertices[2])
        && is_finite(d.opacity) && is_finite(d.sigma);
}

// The gradient of a triangle from its pixels; zeros when it is not finite. That of the colour is by the raw
// colour.
fn triangle_grad(i: u32, triangle: WorldTriangle) -> TriangleGrad {
    var d: TriangleGrad;
    let first = splat_starts[i];
    let end = splat_starts[i + 1u];
    if first >= end {
        return d;
    }
    let whole = whole_triangle(triangle);
    let opacity = drawn_opacity(i);
    for (var splat = first; splat < end; splat++) {
        add_piece(&d, splat, whole, opacity);
    }
    if d.pixels > 0.0 {
        d.rgb = raw_color_grad(d.rgb, records[4u * first + 3u].xyz);
        let view = view_direction(triangle);
        basis = sh_basis(step.scene.z, view.xyz);
        let d_offset = view_grad(i, view, d.rgb);
        for (var k = 0u; k < 3u; k++) {
            d.vertices[k] += d_offset;
        }
    }
    let finite = is_finite_grad(d);
    record_visibility(i, d, finite);
    if !finite {
        atomicAdd(&counts[DROPPED], 1u);
        var nothing: TriangleGrad;
        return nothing;
    }
    return d;
}

// The sum of all absolute numbers of a gradient.
fn magnitude(d: TriangleGrad) -> f32 {
    let corners = abs(d.vertices[0]) + abs(d.vertices[1]) + abs(d.vertices[2]);
    var sum = abs(d.opacity) + abs(d.sigma) + corners.x + corners.y + corners.z;
    for (var k = 0u; k < used_sh(); k++) {
        let by_color = abs(d.rgb * basis[k]);
        sum += by_color.x + by_color.y + by_color.z;
    }
    return sum;
}

// The root of the area, within limits.
fn size(t: WorldTriangle) -> f32 {
    let normal = cross(t.v1 - t.v0, t.v2 - t.v0);
    let most = clamp(SIZE_OF_ALL / sqrt(max(f32(step.scene.x), 1.0)), MIN_SIZE, MAX_SIZE);
    return clamp(sqrt(0.5 * sqrt(dot(normal, normal))), MIN_SIZE, most);
}

// Updates all of a triangle except its colour of degree 0.
fn move_triangle(i: u32, triangle: WorldTriangle, gradient: TriangleGrad) {
    var d = gradient;
    if step.regularisers.y > 0.0 {
        let mean = mean_of(SUM_AREA, 1e-12);
        var by_area = area_grad(triangle, -step.regularisers.y / (mean * mean));
        for (var k = 0u; k < 3u; k++) {
            d.vertices[k] += by_area[k];
        }
    }
    let rate = step.rates.x * size(triangle);
    for (var k = 0u; k < 3u; k++) {
        for (var axis = 0u; axis < 3u; axis++) {
            move_number(3u * k + axis, i, rate, d.vertices[k][axis]);
        }
    }
    let by_logit = anneal_opacity_grad(x[row_at(ROW_OPACITY, i)], d.opacity + step.regularisers.x);
    move_number(ROW_OPACITY, i, step.rates.y, by_logit);
    let by_logarithm = anneal_sigma_grad(x[row_at(ROW_SIGMA, i)], d.sigma);
    move_number(ROW_SIGMA, i, step.rates.z, by_logarithm);
    for (var k = 1u; k < used_sh(); k++) {
        for (var c = 0u; c < 3u; c++) {
            move_number(ROW_SH + 3u * k + c, i, step.update.x, d.rgb[c] * basis[k]);
        }
    }
}

@compute @workgroup_size(UPDATE_GROUP)
fn update(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = chunk.first + workgroup_index(workgroup, workgroups) * UPDATE_GROUP + local;
    if i >= chunk.first + chunk.count {
        return;
    }
    let triangle = triangle_of(i);
    let d = triangle_grad(i, triangle);
    // Frozen triangles come first: they are drawn and stay unchanged.
    if i < step.parts.x {
        return;
    }
    let sum = magnitude(d);
    if !is_finite(sum) {
        atomicAdd(&counts[DROPPED], 1u);
        atomicAdd(&counts[TOUCHED], 1u);
        return;
    }
    if sum == 0.0 && step.update.z == 1.0 {
        return;
    }
    atomicAdd(&counts[TOUCHED], 1u);
    for (var c = 0u; c < 3u; c++) {
        move_number(ROW_SH + c, i, step.rates.w, d.rgb[c] * basis[0]);
    }
    // Pinned triangles keep everything else.
    if i >= step.scene.w {
        move_triangle(i, triangle, d);
    }
}
