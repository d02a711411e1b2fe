//! Soups that have broken bakers, by name, and the scenes that tests run stages on.

use glam::{Vec3, vec3};
pub(crate) use trisplat_fixtures::soups::{random_triangle, soup_of};
use trisplat_scene::{
    Rng, Soup,
    mesh::{Colors, Mesh},
};
use trisplat_synthetic::soups::{degenerate, studio};

/// `count` random triangles in the unit cube.
pub(crate) fn random(count: u64, size: f32) -> Soup {
    let rng = Rng::new(13, "test place", 0);
    soup_of((0..count).map(|i| {
        let place = vec3(rng.uniform(3 * i), rng.uniform(3 * i + 1), rng.uniform(3 * i + 2));
        (random_triangle(i, place, size), 0.2 + 0.8 * rng.uniform(i), 0.05 + rng.uniform(i))
    }))
}

const RIGHT: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

fn scaled(scale: f32) -> Soup {
    let mut soup = random(300, 0.2);
    soup.vertices.iter_mut().flatten().for_each(|v| *v *= scale);
    soup
}

/// One value of the second triangle replaced.
fn poisoned(poison: impl Fn(&mut Soup)) -> Soup {
    let mut soup = random(50, 0.2);
    poison(&mut soup);
    soup
}

/// Soups a reader could hand over.
pub(crate) fn finite() -> Vec<(&'static str, Soup)> {
    let mut sigmas = random(300, 0.2);
    let mut opacities = random(300, 0.2);
    for i in 0..300 {
        sigmas.sigma[i] = 10f32.powf(-4.0 + 7.0 * i as f32 / 299.0);
        opacities.opacity[i] = [0.0, 1.0, f32::MIN_POSITIVE, 0.5, 1.0 - f32::EPSILON][i % 5];
    }
    let shell = random(300, 0.01).vertices.into_iter().enumerate().map(|(i, corners)| {
        let far = i % 20 == 0;
        (corners.map(|v| if far { 1e6 * (v - 0.5) } else { v }), 0.9, 0.1)
    });
    let sliver = |i: u64| {
        let along = random_triangle(i, Vec3::splat(i as f32), 2.0);
        [along[0], along[1], along[0].lerp(along[1], 0.4) + 1e-4 * Vec3::Z]
    };
    vec![
        ("empty", Soup::default()),
        ("one triangle", soup_of([(RIGHT, 0.9, 0.5)])),
        ("two triangles", soup_of([(RIGHT, 0.9, 0.5), (RIGHT.map(|v| v + 1.0), 0.9, 0.5)])),
        ("all points", soup_of((0..50).map(|i| ([Vec3::splat(i as f32); 3], 0.9, 0.5)))),
        (
            "all lines",
            soup_of(
                (0..50).map(|i| {
                    ([Vec3::ZERO, Vec3::X, 3.0 * Vec3::X].map(|v| v * i as f32), 0.9, 0.5)
                }),
            ),
        ),
        ("slivers", soup_of((0..300).map(|i| (sliver(i), 0.9, 0.5)))),
        ("identical", soup_of((0..3000).map(|_| (RIGHT, 0.9, 0.5)))),
        (
            "identical, far from the origin",
            soup_of((0..3000).map(|_| (RIGHT.map(|v| v + 1e5), 0.9, 0.5))),
        ),
        ("twins", soup_of((0..600).map(|i| (random_triangle(i / 2, Vec3::ZERO, 1.0), 0.9, 0.5)))),
        (
            "growing along a line",
            soup_of(
                (0..600)
                    .map(|i| {
                        let at = 1.03f32.powi(i);
                        (RIGHT.map(|v| 0.3 * at * v + at * Vec3::X), 0.9, 0.5)
                    })
                    .filter(|(corners, ..)| corners.iter().all(|v| v.is_finite())),
            ),
        ),
        (
            "coplanar",
            soup_of(
                random(300, 0.2)
                    .vertices
                    .into_iter()
                    .map(|t| (t.map(|v| v * vec3(1.0, 1.0, 0.0)), 0.9, 0.5)),
            ),
        ),
        ("far shell", soup_of(shell)),
        ("1e14", scaled(1e14)),
        ("1e38", scaled(1e38)),
        ("1e-18", scaled(1e-18)),
        ("denormal", scaled(1e-42)),
        ("sigma 1e-4 to 1e3", sigmas),
        ("opacity 0 and 1", opacities),
        ("invisible", soup_of((0..50).map(|i| (random_triangle(i, Vec3::ZERO, 1.0), 0.0, 0.5)))),
        ("softest", soup_of((0..50).map(|i| (random_triangle(i, Vec3::ZERO, 1.0), 1.0, 1e3)))),
        ("studio", studio(3000, 1)),
        ("degenerate sample", degenerate()),
    ]
}

/// Soups that only the prune stage may meet.
pub(crate) fn poison() -> Vec<(&'static str, Soup)> {
    vec![
        ("NaN vertex", poisoned(|s| s.vertices[1][2].y = f32::NAN)),
        ("infinite vertex", poisoned(|s| s.vertices[1][0].x = f32::INFINITY)),
        ("vertex 3e38", poisoned(|s| s.vertices[1][0].x = -3e38)),
        ("NaN opacity", poisoned(|s| s.opacity[1] = f32::NAN)),
        ("NaN sigma", poisoned(|s| s.sigma[1] = f32::NAN)),
        ("infinite sigma", poisoned(|s| s.sigma[1] = f32::INFINITY)),
        ("NaN colour", poisoned(|s| s.sh[1][2] = f32::NAN)),
        ("infinite colour", poisoned(|s| s.sh[1][0] = f32::NEG_INFINITY)),
    ]
}

/// The soup as a mesh with face colours, for the stages that want one.
pub(crate) fn mesh_of(soup: &Soup) -> Mesh {
    trisplat_bake::color(soup.clone(), &mut Default::default()).unwrap()
}

/// A connected `side` x `side` grid of quads in the plane z = 0 with colours per vertex.
pub(crate) fn grid(side: u32) -> Mesh {
    let row = side + 1;
    let at = |x: u32, y: u32| y * row + x;
    let quad =
        |x, y| [at(x, y), at(x + 1, y), at(x, y + 1), at(x + 1, y), at(x + 1, y + 1), at(x, y + 1)];
    let place = |v: u32| vec3((v % row) as f32, (v / row) as f32, 0.0);
    Mesh {
        positions: (0..row * row).map(place).collect(),
        colors: Colors::Vertex(
            (0..row * row).map(|v| [v as f32 / (row * row) as f32, 0.5, 1.0]).collect(),
        ),
        indices: (0..side * side).flat_map(|q| quad(q % side, q / side)).collect(),
        opacity: Vec::new(),
        ..Mesh::default()
    }
}
