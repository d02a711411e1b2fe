// Triangles to splats. Counts the splats of each triangle, and later writes them at the places from the scan
// of the counts. One pass does both, so that both find the same splats.

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> chunk: Chunk;
@group(0) @binding(2) var<storage, read> x: array<f32>;
@group(0) @binding(3) var<storage, read_write> splat_starts: array<u32>;
@group(0) @binding(4) var<storage, read_write> records: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> bounds: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> planes: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> pieces: array<u32>;
@group(0) @binding(8) var<storage, read_write> depths: array<u32>;

struct Projected {
    splat: Splat,
    floor: f32,
    scale: f32,
    log2_opacity: f32,
    bounds: vec4<f32>,
    is_drawn: bool,
}

// Box of the triangle shrunk about its incenter by 1 - floor.
fn screen_box(splat: Splat, floor: f32) -> vec4<f32> {
    let middle = incenter(splat);
    let a = splat.origin + middle + (vec2(0.0) - middle) * (1.0 - floor);
    let b = splat.origin + middle + (splat.side1 - middle) * (1.0 - floor);
    let c = splat.origin + middle + (splat.side2 - middle) * (1.0 - floor);
    return vec4(min(min(a, b), c), max(max(a, b), c));
}

fn is_finite_splat(splat: Splat) -> bool {
    let edges = abs(splat.edge[0]) + abs(splat.edge[1]) + abs(splat.edge[2]);
    let sum = edges.x + edges.y + splat.shift + splat.inradius + abs(splat.origin.x) + abs(splat.origin.y);
    return is_finite(sum);
}

fn project_piece(corners: CameraTriangle, full_opacity: f32, sigma: f32) -> Projected {
    var out: Projected;
    out.is_drawn = false;
    out.splat = project_splat(corners, step.lens.xy, step.lens.zw);
    let inradius = out.splat.inradius;
    if !(inradius > 0.0 && is_finite_splat(out.splat)) {
        return out;
    }
    let cutoff = step.limits.x;
    var opacity = full_opacity;
    if step.modes.x == WINDOW_SOFT {
        opacity *= fade(inradius, step.edges.x);
    }
    if !(opacity > cutoff) {
        return out;
    }
    out.log2_opacity = log2_lane(opacity);
    switch step.modes.x {
        case WINDOW_SOFT: {
            out.scale = 1.0;
            out.floor = ratio_floor(out.log2_opacity, sigma, step.limits.y);
            out.bounds = screen_box(out.splat, out.floor);
        }
        default: { // WINDOW_COVERAGE
            let width = step.edges.z;
            out.scale = inradius / width;
            out.floor = cutoff / opacity;
            out.bounds = screen_box(out.splat, 0.0) + vec4(-width, -width, width, width);
        }
    }
    let size = vec2<f32>(step.frame.xy);
    let seen = all(out.bounds.zw > vec2(0.0)) && all(out.bounds.xy < size);
    out.is_drawn = out.floor < 1.0 && seen;
    return out;
}

fn triangle_color(i: u32, triangle: WorldTriangle) -> vec3<f32> {
    let used = (step.scene.z + 1u) * (step.scene.z + 1u);
    var basis = sh_basis(step.scene.z, view_direction(triangle).xyz);
    var rgb = vec3(0.5);
    for (var k = 0u; k < used; k++) {
        let at = row_at(ROW_SH + 3u * k, i);
        rgb += basis[k] * vec3(x[at], x[at + chunk.count], x[at + 2u * chunk.count]);
    }
    rgb = max(rgb, vec3(0.0));
    if step.edges.w == 1.0 {
        rgb = vec3(linear_from_srgb(rgb.x), linear_from_srgb(rgb.y), linear_from_srgb(rgb.z));
    }
    return rgb;
}

fn write_splat(at: u32, i: u32, piece: u32, corners: CameraTriangle, projected: Projected, sigma: f32, rgb: vec3<f32>) {
    let splat = projected.splat;
    let scale = projected.scale;
    records[4u * at] = vec4(splat.origin, scale * splat.edge[0]);
    records[4u * at + 1u] = vec4(scale * splat.edge[1], scale * splat.edge[2]);
    records[4u * at + 2u] = vec4(scale * splat.shift, projected.floor, sigma, projected.log2_opacity);
    records[4u * at + 3u] = vec4(rgb, bitcast<f32>(i));
    bounds[at] = projected.bounds;
    pieces[at] = piece;
    let depth = corners.first.z + (corners.edge1.z + corners.edge2.z) * (1.0 / 3.0);
    depths[at] = bitcast<u32>(depth);
    if step.modes.y == 1u || step.modes.z == 1u {
        let plane = depth_plane(corners, step.lens.xy);
        planes[2u * at] = vec4(plane.inv_depth, plane.slope, plane.normal.x);
        planes[2u * at + 1u] = vec4(plane.normal.yz, 0.0, 0.0);
    }
}

@compute @workgroup_size(GROUP)
fn project(
    @builtin(workgroup_id) workgroup: vec3<u32>,
    @builtin(num_workgroups) workgroups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = chunk.first + workgroup_index(workgroup, workgroups) * GROUP + local;
    let n = step.scene.x;
    // The last chunk has one more place, for the sum of all.
    if i >= chunk.first + chunk.count && (i != n || chunk.writes == 1u) {
        return;
    }
    var count = 0u;
    if i < n {
        let first = select(0u, splat_starts[i], chunk.writes == 1u);
        // When writing: only those counted.
        let room = select(2u, min(splat_starts[i + 1u], arrayLength(&pieces)) - min(first, arrayLength(&pieces)), chunk.writes == 1u);
        let opacity = drawn_opacity(i);
        if room > 0u && opacity > step.limits.x {
            let sigma = drawn_sigma(i);
            let triangle = WorldTriangle(corner_of(i, 0u), corner_of(i, 1u), corner_of(i, 2u));
            let whole = whole_triangle(triangle);
            var found = clip_pieces(front_bits(whole));
            var rgb = vec3(0.0);
            if chunk.writes == 1u {
                rgb = triangle_color(i, triangle);
            }
            for (var k = 0u; k < found.count; k++) {
                let piece = found.piece[k];
                let corners = clipped(whole, piece);
                let projected = project_piece(corners, opacity, sigma);
                if projected.is_drawn && count < room {
                    if chunk.writes == 1u {
                        write_splat(first + count, i, piece, corners, projected, sigma, rgb);
                    }
                    count += 1u;
                }
            }
        }
    }
    if chunk.writes == 0u {
        splat_starts[i] = count;
    }
}
