// The twin of kernel/splat.rs (Held et al. 2025, section 3).

struct CameraTriangle {
    first: vec3<f32>,
    edge1: vec3<f32>,
    edge2: vec3<f32>,
}

struct Splat {
    origin: vec2<f32>,
    side1: vec2<f32>,
    side2: vec2<f32>,
    edge: array<vec2<f32>, 3>,
    shift: f32,
    inradius: f32,
}

struct SplatGrad {
    ratio: vec3<f32>,
    moment: array<vec2<f32>, 3>,
    inradius: f32,
    by_incenter: f32,
}

struct DepthPlane {
    inv_depth: f32,
    slope: vec2<f32>,
    normal: vec3<f32>,
}

fn cross2(a: vec2<f32>, b: vec2<f32>) -> f32 {
    return a.x * b.y - a.y * b.x;
}

fn perp(a: vec2<f32>) -> vec2<f32> {
    return vec2(-a.y, a.x);
}

fn length2(a: vec2<f32>) -> f32 {
    return sqrt(dot(a, a));
}

fn side(u: vec2<f32>, first_z: f32, e: vec3<f32>, focal: vec2<f32>) -> vec2<f32> {
    return (e.xy - u * e.z) * focal * (1.0 / (first_z + e.z));
}

fn project_splat(corners: CameraTriangle, focal: vec2<f32>, center: vec2<f32>) -> Splat {
    let u = corners.first.xy * (1.0 / corners.first.z);
    let a = side(u, corners.first.z, corners.edge1, focal);
    let b = side(u, corners.first.z, corners.edge2, focal);
    let lengths = vec3(length2(a), length2(b - a), length2(b));
    let perimeter = lengths.x + lengths.y + lengths.z;
    let area = cross2(a, b);
    let scale = perimeter / area;
    var out: Splat;
    out.origin = u * focal + center;
    out.side1 = a;
    out.side2 = b;
    out.edge[0] = perp(a) * (scale / lengths.x);
    out.edge[1] = perp(b - a) * (scale / lengths.y);
    out.edge[2] = perp(-b) * (scale / lengths.z);
    out.shift = dot(out.edge[1], a);
    out.inradius = abs(area) / perimeter;
    return out;
}

fn splat_grad(corners: CameraTriangle, focal: vec2<f32>, splat: Splat, d: SplatGrad) -> CameraTriangle {
    let a = splat.side1;
    let b = splat.side2;
    var outline = array<vec2<f32>, 3>(a, b - a, -b);
    let lengths = vec3(length2(a), length2(b - a), length2(b));
    let perimeter = lengths.x + lengths.y + lengths.z;
    let area = cross2(a, b);
    let d_shift = -d.ratio.y;
    var edge = splat.edge;
    var d_edge = d.moment;
    d_edge[1] += a * d_shift;
    var d_perimeter = 0.0;
    var d_cross = 0.0;
    var d_lengths: vec3<f32>;
    var d_outline: array<vec2<f32>, 3>;
    for (var i = 0; i < 3; i++) {
        let along = dot(d_edge[i], edge[i]);
        let c = perimeter / (area * lengths[i]);
        d_outline[i] = -perp(d_edge[i]) * c;
        d_lengths[i] = -along / lengths[i];
        d_perimeter += along / perimeter;
        d_cross -= along / area;
    }
    let sign = abs(area) / area;
    d_perimeter = (d_perimeter - d.inradius * splat.inradius / perimeter) * d.by_incenter;
    d_cross = (d_cross + d.inradius * sign / perimeter) * d.by_incenter;
    for (var i = 0; i < 3; i++) {
        d_outline[i] += outline[i] * ((d_lengths[i] + d_perimeter) / lengths[i]);
    }
    let d_a = d_outline[0] - d_outline[1] - perp(b) * d_cross + splat.edge[1] * d_shift;
    let d_b = d_outline[1] - d_outline[2] + perp(a) * d_cross;
    let d_origin = -(splat.edge[0] * d.ratio.x + splat.edge[1] * d.ratio.y + splat.edge[2] * d.ratio.z);
    return screen_grad(corners, focal, splat, d_origin, d_a, d_b);
}

fn screen_grad(
    corners: CameraTriangle,
    focal: vec2<f32>,
    splat: Splat,
    d_origin: vec2<f32>,
    d_a: vec2<f32>,
    d_b: vec2<f32>,
) -> CameraTriangle {
    let inv_z = 1.0 / corners.first.z;
    let u = corners.first.xy * inv_z;
    let inv_a = 1.0 / (corners.first.z + corners.edge1.z);
    let inv_b = 1.0 / (corners.first.z + corners.edge2.z);
    let g_a = d_a * focal * inv_a;
    let g_b = d_b * focal * inv_b;
    let d_u = d_origin * focal - g_a * corners.edge1.z - g_b * corners.edge2.z;
    let d_z_a = -dot(d_a, splat.side1) * inv_a;
    let d_z_b = -dot(d_b, splat.side2) * inv_b;
    let d_xy = d_u * inv_z;
    var out: CameraTriangle;
    out.first = vec3(d_xy, d_z_a + d_z_b - dot(d_u, u) * inv_z);
    out.edge1 = vec3(g_a, d_z_a - dot(g_a, u));
    out.edge2 = vec3(g_b, d_z_b - dot(g_b, u));
    return out;
}

fn max_abs(v: vec3<f32>) -> f32 {
    return max(max(abs(v.x), abs(v.y)), abs(v.z));
}

// The edges scaled to a size of one, so that no square can overflow.
fn edge_scale(corners: CameraTriangle) -> f32 {
    return 1.0 / max(max_abs(corners.edge1), max_abs(corners.edge2));
}

fn depth_plane(corners: CameraTriangle, focal: vec2<f32>) -> DepthPlane {
    let scale = edge_scale(corners);
    let n = cross(corners.edge1 * scale, corners.edge2 * scale);
    let offset = dot(n, corners.first);
    let inv_length = 1.0 / sqrt(dot(n, n));
    var out: DepthPlane;
    out.inv_depth = 1.0 / corners.first.z;
    out.slope = n.xy / focal * (1.0 / offset);
    out.normal = n * select(-inv_length, inv_length, offset < 0.0);
    return out;
}

fn depth_plane_grad(
    corners: CameraTriangle,
    focal: vec2<f32>,
    splat: Splat,
    plane: DepthPlane,
    d: DepthPlane,
) -> CameraTriangle {
    let scale = edge_scale(corners);
    let e1 = corners.edge1 * scale;
    let e2 = corners.edge2 * scale;
    let n = cross(e1, e2);
    let offset = dot(n, corners.first);
    let inv_offset = 1.0 / offset;
    let inv_length = 1.0 / sqrt(dot(n, n));
    let signed = select(-inv_length, inv_length, offset < 0.0);
    let d_offset = -dot(d.slope, plane.slope) * inv_offset;
    var d_n = (d.normal - plane.normal * dot(plane.normal, d.normal)) * signed;
    d_n += vec3(d.slope / focal * inv_offset, 0.0) + corners.first * d_offset;
    var d_first = n * d_offset;
    d_first.z -= d.inv_depth * plane.inv_depth * plane.inv_depth;
    let moved = screen_grad(corners, focal, splat, -plane.slope * d.inv_depth, vec2(0.0), vec2(0.0));
    d_n *= scale;
    var out: CameraTriangle;
    out.first = d_first + moved.first;
    out.edge1 = cross(e2, d_n);
    out.edge2 = cross(d_n, e1);
    return out;
}

fn fade_position(inradius: f32, full_px: f32) -> f32 {
    var x = 1.0;
    if inradius < full_px {
        x = inradius / full_px;
    }
    return max(x, 0.0);
}

fn fade(inradius: f32, full_px: f32) -> f32 {
    let x = fade_position(inradius, full_px);
    return x * x * (3.0 - x - x);
}

fn fade_grad(inradius: f32, full_px: f32) -> f32 {
    if !(0.0 < full_px && inradius < full_px) {
        return 0.0;
    }
    let x = fade_position(inradius, full_px);
    return 6.0 * x * (1.0 - x) / full_px;
}

fn incenter(splat: Splat) -> vec2<f32> {
    let l0 = length2(splat.side1);
    let l1 = length2(splat.side2 - splat.side1);
    let l2 = length2(splat.side2);
    return (splat.side1 * l2 + splat.side2 * l0) * (1.0 / (l0 + l1 + l2));
}
