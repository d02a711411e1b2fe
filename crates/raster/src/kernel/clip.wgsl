// The twin of kernel/clip.rs. A piece is six numbers of two bits: for each of its corners the triangle's corner in
// front of the plane, and the one behind it or the same.

const WHOLE: u32 = 0xa50u; // (0, 0), (1, 1), (2, 2)

struct Pieces {
    piece: array<u32, 2>,
    count: u32,
}

fn piece_corner(front: u32, back: u32, at: u32) -> u32 {
    return (front | (back << 2u)) << (4u * at);
}

// Bit i of `front` says whether corner i is in front of the plane.
fn clip_pieces(front: u32) -> Pieces {
    var out = Pieces(array<u32, 2>(WHOLE, WHOLE), 1u);
    if front == 7u || front == 0u {
        out.count = select(0u, 1u, front == 7u);
        return out;
    }
    // Corner i is alone on its side, j and k follow it.
    let in_front = countOneBits(front);
    let alone = select(7u ^ front, front, in_front == 1u);
    let i = firstTrailingBit(alone);
    let j = (i + 1u) % 3u;
    let k = (i + 2u) % 3u;
    if in_front == 1u {
        out.piece[0] = piece_corner(i, i, 0u) | piece_corner(i, j, 1u) | piece_corner(i, k, 2u);
        return out;
    }
    out.piece[0] = piece_corner(j, j, 0u) | piece_corner(k, k, 1u) | piece_corner(k, i, 2u);
    out.piece[1] = piece_corner(j, j, 0u) | piece_corner(k, i, 1u) | piece_corner(j, i, 2u);
    out.count = 2u;
    return out;
}

fn near_point(front: vec3<f32>, back: vec3<f32>, near: f32) -> vec3<f32> {
    let t = (near - front.z) / (back.z - front.z);
    return vec3(fma(back.xy - front.xy, vec2(t), front.xy), near);
}

struct NearPointGrad {
    front: vec3<f32>,
    back: vec3<f32>,
}

fn near_point_grad(front: vec3<f32>, back: vec3<f32>, near: f32, d: vec3<f32>) -> NearPointGrad {
    let edge = back - front;
    let t = (near - front.z) / edge.z;
    let rest = 1.0 - t;
    let d_t = dot(d.xy, edge.xy) / edge.z;
    return NearPointGrad(vec3(d.xy * rest, -(d_t * rest)), vec3(d.xy * t, -(d_t * t)));
}
