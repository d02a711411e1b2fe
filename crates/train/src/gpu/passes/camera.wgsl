// World triangles in camera space, clipped at the near plane: the twin of raster/soft/splats.rs. Needs `step`.

struct WorldTriangle {
    v0: vec3<f32>,
    v1: vec3<f32>,
    v2: vec3<f32>,
}

fn rotate(v: vec3<f32>) -> vec3<f32> {
    return step.rotation[0].xyz * v.x + step.rotation[1].xyz * v.y + step.rotation[2].xyz * v.z;
}

fn rotate_back(v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(step.rotation[0].xyz, v), dot(step.rotation[1].xyz, v), dot(step.rotation[2].xyz, v));
}

fn whole_triangle(t: WorldTriangle) -> CameraTriangle {
    let translation = vec3(step.rotation[0].w, step.rotation[1].w, step.rotation[2].w);
    return CameraTriangle(rotate(t.v0) + translation, rotate(t.v1 - t.v0), rotate(t.v2 - t.v0));
}

fn camera_corner(whole: CameraTriangle, corner: u32) -> vec3<f32> {
    if corner == 0u {
        return whole.first;
    }
    return whole.first + select(whole.edge2, whole.edge1, corner == 1u);
}

// Bit i says whether corner i is in front of the near plane.
fn front_bits(whole: CameraTriangle) -> u32 {
    let near = step.position.w;
    let second = (whole.first + whole.edge1).z >= near;
    let third = (whole.first + whole.edge2).z >= near;
    return select(0u, 1u, whole.first.z >= near) | select(0u, 2u, second) | select(0u, 4u, third);
}

fn front_corner(piece: u32, at: u32) -> u32 {
    return (piece >> (4u * at)) & 3u;
}

fn back_corner(piece: u32, at: u32) -> u32 {
    return (piece >> (4u * at + 2u)) & 3u;
}

fn piece_point(whole: CameraTriangle, piece: u32, at: u32) -> vec3<f32> {
    let front = front_corner(piece, at);
    let back = back_corner(piece, at);
    let a = camera_corner(whole, front);
    if front == back {
        return a;
    }
    return near_point(a, camera_corner(whole, back), step.position.w);
}

fn clipped(whole: CameraTriangle, piece: u32) -> CameraTriangle {
    if piece == WHOLE {
        return whole;
    }
    let a = piece_point(whole, piece, 0u);
    return CameraTriangle(a, piece_point(whole, piece, 1u) - a, piece_point(whole, piece, 2u) - a);
}

// Unit direction from the camera to the centroid; the distance.
fn view_direction(t: WorldTriangle) -> vec4<f32> {
    let offset = (t.v0 - step.position.xyz) + ((t.v1 - t.v0) + (t.v2 - t.v0)) * (1.0 / 3.0);
    let size = max_abs(offset);
    // The squares of much smaller or larger numbers leave the range of f32.
    if !(size > 0.0) {
        return vec4(0.0, 0.0, 1.0, 0.0);
    }
    let scaled = offset / size;
    let length = sqrt(dot(scaled, scaled));
    return vec4(scaled / length, length * size);
}
