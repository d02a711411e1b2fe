//! Shapes with a known surface, and cameras around them.

use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_scene::camera::Camera;
use trisplat_scene::mesh::{Colors, Mesh};

/// The radius of the ball, half the side of the cube.
pub(crate) const RADIUS: f32 = 1.0;

/// A square patch of the cube from -1 to 1 for each of its sides, `n` by `n` quadrilaterals; `bend`
/// moves the points.
fn patches(n: usize, bend: impl Fn(Vec3) -> Vec3, color: impl Fn(Vec3) -> [f32; 3]) -> Mesh {
    let mut positions = Vec::new();
    let mut colors = Vec::new();
    for (normal, right) in [(Vec3::X, Vec3::Y), (Vec3::Y, Vec3::Z), (Vec3::Z, Vec3::X)] {
        for sign in [1.0, -1.0] {
            let up = normal.cross(right) * sign;
            let at = |i: usize, j: usize| {
                let along = |k: usize| 2.0 * k as f32 / n as f32 - 1.0;
                bend(normal * sign + right * along(i) + up * along(j))
            };
            for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
                let [a, b, c, d] = [at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)];
                for corner in [a, b, c, a, c, d] {
                    positions.push(corner);
                    colors.push(color(corner));
                }
            }
        }
    }
    Mesh { positions, colors: Colors::Vertex(colors), ..Mesh::default() }
}

/// Red where x > 0, blue elsewhere.
pub(crate) fn two_colors(at: Vec3) -> [f32; 3] {
    if at.x > 0.0 { [0.8, 0.1, 0.1] } else { [0.1, 0.1, 0.8] }
}

/// A ball around `center`, so finely cut that it is round to a thousandth.
pub(crate) fn ball(center: Vec3) -> Mesh {
    coarse_ball(center, 48)
}

/// A ball around `center` of 12 n² triangles.
pub(crate) fn coarse_ball(center: Vec3, n: usize) -> Mesh {
    patches(n, |p| center + RADIUS * p.normalize(), |p| two_colors(p - center))
}

/// A cube around the origin.
pub(crate) fn cube() -> Mesh {
    patches(8, |p| RADIUS * p, two_colors)
}

/// A camera of `side` px square at `eye` that looks at the origin.
pub(crate) fn camera(eye: Vec3, side: u32) -> Camera {
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(side as f32),
        center: Vec2::splat(side as f32 / 2.0),
        size: UVec2::splat(side),
    };
    lens.with_look_at(eye, Vec3::ZERO, Vec3::NEG_Y)
}

/// `count` cameras all around, at `distance`.
pub(crate) fn around(count: u32, distance: f32, side: u32) -> Vec<Camera> {
    let eye = |i: u32| {
        let y = 1.0 - 2.0 * (i as f32 + 0.5) / count as f32;
        let (sin, cos) = (i as f32 * 2.399_963).sin_cos();
        Vec3::new((1.0 - y * y).sqrt() * cos, y, (1.0 - y * y).sqrt() * sin) * distance
    };
    (0..count).map(|i| camera(eye(i), side)).collect()
}
