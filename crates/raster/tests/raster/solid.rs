//! The solid rasteriser against a ray caster in double precision that tests every face for every
//! sample; it states where the two may differ.

use glam::{Mat3, Quat, UVec2, Vec2, Vec3};
use trisplat_oracle::ray_caster::{FaceAt, RayFace, ray};
use trisplat_raster::solid::{
    Barycentrics, NO_FACE, SolidRasterOptions, SolidRasterizer, Visibility,
};
use trisplat_scene::{
    Rng,
    camera::Camera,
    math::color::linear_from_srgb,
    math::color::srgb8_from_linear,
    mesh::{Colors, Mesh},
};

fn camera(size: UVec2) -> Camera {
    Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::new(0.9, 1.1) * size.x as f32,
        center: size.as_vec2() * Vec2::new(0.45, 0.6),
        size,
    }
}

fn mesh(corners: Vec<[Vec3; 3]>) -> Mesh {
    let color = |i: usize| [0, 1, 2].map(|c| Rng::new(3, "color", i as u64).uniform(c));
    let colors = Colors::Face((0..corners.len()).map(color).collect());
    Mesh { positions: corners.into_flattened(), colors, ..Mesh::default() }
}

/// Compares a frame with the ray caster; returns the share of samples on which the two differ.
fn compare(name: &str, mesh: &Mesh, camera: &Camera, options: &SolidRasterOptions) -> f64 {
    let mut solid = SolidRasterizer::new();
    let drawn = solid.visibility(mesh, camera, options).clone();
    assert_eq!(drawn.size, camera.size * options.samples);
    let near = f64::from(options.near);
    let face = |f: usize| RayFace::new(camera, options.samples, near, mesh.corners(f));
    let faces: Vec<RayFace> = (0..mesh.face_count()).map(face).collect();
    let mut differ = 0;
    for y in 0..drawn.size.y {
        for x in 0..drawn.size.x {
            let at = (y * drawn.size.x + x) as usize;
            let ray = ray(camera, options.samples, x, y);
            let seen =
                faces.iter().enumerate().filter_map(|(f, face)| Some((f as u32, face.at(ray)?)));
            let seen: Vec<(u32, FaceAt)> = seen.collect();
            let nearest = seen.iter().filter(|(_, s)| s.covers() && s.w < 1.0 / near);
            let nearest = nearest.max_by(|a, b| a.1.w.total_cmp(&b.1.w).then(b.0.cmp(&a.0)));
            let got = drawn.face[at];
            differ += usize::from(nearest.map_or(NO_FACE, |n| n.0) != got);
            let place = format!("{name}, {} samples, sample {x} {y}: face {got}", options.samples);
            let mine = seen.iter().find(|(f, _)| *f == got);
            let limit = match mine {
                Some((_, mine)) => mine.w + mine.slack,
                None => {
                    assert_eq!(got, NO_FACE, "{place} is not hit by the oracle");
                    assert_eq!(drawn.depth[at], f32::INFINITY);
                    0.0
                }
            };
            for (face, other) in &seen {
                let before = other.certainly_covers(near) && other.w - other.slack > limit;
                assert!(*face == got || !before, "{place} hides {face}: {} {limit}", other.w);
            }
            if let Some((_, mine)) = mine {
                compare_sample(&place, mesh, camera, &drawn, [x, y], mine);
            }
        }
    }
    differ as f64 / drawn.face.len() as f64
}

/// Depth and weights of a sample.
fn compare_sample(
    place: &str,
    mesh: &Mesh,
    camera: &Camera,
    drawn: &Visibility,
    [x, y]: [u32; 2],
    mine: &FaceAt,
) {
    let depth = f64::from(drawn.depth[(y * drawn.size.x + x) as usize]);
    assert!(depth > 0.0 && depth.is_finite(), "{place}: depth {depth}");
    let off = (1.0 / depth - mine.w).abs();
    assert!(!(off > mine.slack * 1.5), "{place}: 1/z {} is not {}", 1.0 / depth, mine.w);
    let weights = barycentrics(drawn, mesh, camera, x, y);
    assert!((weights.iter().sum::<f32>() - 1.0).abs() < 1e-6, "{place}: {weights:?}");
    assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)), "{place}: {weights:?}");
    if mine.covers() {
        let far = weights.iter().zip(mine.weights).any(|(a, b)| (f64::from(*a) - b).abs() > 1e-5);
        assert!(!far, "{place}: {weights:?} are not {:?}", mine.weights);
    }
}

/// Barycentric coordinates of the face at a sample; zeros for an empty one.
fn barycentrics(drawn: &Visibility, mesh: &Mesh, camera: &Camera, x: u32, y: u32) -> [f32; 3] {
    let face = drawn.face[(y * drawn.size.x + x) as usize];
    if face == NO_FACE {
        return [0.0; 3];
    }
    let barycentrics = Barycentrics::new(mesh, camera, drawn.size.x / camera.size.x);
    barycentrics.weights(&barycentrics.face(face), x, y)
}

/// `count` triangles around (0, 0, depth), of sizes from `small` to `large`.
fn cloud(seed: u64, count: usize, depth: f32, small: f32, large: f32) -> Vec<[Vec3; 3]> {
    let one = |i: usize| {
        let rng = Rng::new(seed, "cloud", i as u64);
        let at = |n: u64| rng.uniform(n) * 2.0 - 1.0;
        let center =
            Vec3::new(at(0), at(1), 0.0) * depth * 0.7 + Vec3::Z * depth * (1.0 + 0.5 * at(2));
        let size = small * (large / small).powf(rng.uniform(3));
        [4, 7, 10].map(|n| center + size * Vec3::new(at(n), at(n + 1), at(n + 2)))
    };
    (0..count).map(one).collect()
}

/// Names and scenes.
fn scenes() -> Vec<(&'static str, Vec<[Vec3; 3]>)> {
    let sliver = |t: [Vec3; 3]| [t[0], t[1], t[0].lerp(t[1], 0.4) + (t[2] - t[0]) * 1e-3];
    let mut flat = cloud(8, 40, 3.0, 0.2, 2.0);
    flat.extend(cloud(9, 20, 3.0, 0.2, 2.0).iter().map(|t| [t[0], t[0], t[1]]));
    flat.extend(cloud(10, 20, 3.0, 0.2, 2.0).iter().map(|t| [t[0]; 3]));
    flat.extend(cloud(11, 20, 3.0, 0.2, 2.0).iter().map(|t| [t[0], t[1], t[0].lerp(t[1], 0.5)]));
    vec![
        ("small", cloud(1, 600, 4.0, 0.01, 0.2)),
        ("subpixel", cloud(2, 3000, 4.0, 0.001, 0.05)),
        ("mixed", cloud(3, 300, 4.0, 0.02, 3.0)),
        ("large", cloud(4, 60, 4.0, 2.0, 30.0)),
        ("around the camera", cloud(5, 100, 0.0, 0.1, 8.0)),
        ("huge", cloud(6, 40, 5.0, 1e3, 1e5)),
        ("slivers", cloud(7, 400, 4.0, 0.3, 4.0).into_iter().map(sliver).collect()),
        (
            "slivers around the camera",
            cloud(12, 200, 0.0, 1.0, 50.0).into_iter().map(sliver).collect(),
        ),
        ("degenerate", flat),
        ("behind", cloud(13, 50, -4.0, 0.1, 1.0)),
        ("nothing", Vec::new()),
    ]
}

#[test]
fn every_sample_sees_what_the_oracle_sees() {
    for (name, corners) in scenes() {
        for (samples, size) in
            [(1, UVec2::new(57, 38)), (2, UVec2::new(27, 17)), (4, UVec2::new(14, 8))]
        {
            let options =
                SolidRasterOptions { samples, near: 0.05, ..SolidRasterOptions::default() };
            let differ = compare(name, &mesh(corners.clone()), &camera(size), &options);
            eprintln!("{name}, {samples} samples: {:.3}% differ", 100.0 * differ);
            // The band is narrow: where edges are not everywhere, hardly a sample lies in it.
            let most = if name.contains("sliver") || name == "subpixel" { 0.005 } else { 0.002 };
            assert!(differ <= most, "{name}: {differ}");
        }
    }
}

#[test]
fn a_world_far_from_its_origin_is_drawn_as_sharply() {
    let size = UVec2::new(60, 40);
    for (far, angle) in [(1e6, 0.0), (1e6, 1.2), (3e4, 2.5)] {
        let offset = Vec3::new(far, -far, 0.5 * far);
        let rotation =
            Mat3::from_quat(Quat::from_axis_angle(Vec3::new(1.0, 2.0, -0.5).normalize(), angle));
        // Single-precision coordinates are 1/16 apart there, so everything is larger, but the
        // camera is near enough for its position to matter to less than that.
        let corners = cloud(14, 200, 40.0, 2.0, 30.0).into_iter();
        let corners = corners.map(|t| t.map(|v| rotation.transpose() * v + offset)).collect();
        let camera = Camera { rotation, translation: -(rotation * offset), ..camera(size) };
        let options = SolidRasterOptions { near: 0.5, ..SolidRasterOptions::default() };
        let differ = compare("far", &mesh(corners), &camera, &options);
        assert!(differ < 0.005, "{differ}");
    }
}

/// A grid of jittered points that covers the picture and more.
fn net(depth: impl Fn(f32, f32) -> f32) -> Mesh {
    const SIDE: usize = 23;
    let rng = Rng::new(1, "net", 0);
    let point = |i: usize| {
        let jitter = |n: u64| 0.6 * (rng.uniform(3 * i as u64 + n) - 0.5);
        let x = ((i % SIDE) as f32 + jitter(0)) / (SIDE - 1) as f32 * 6.0 - 3.0;
        let y = ((i / SIDE) as f32 + jitter(1)) / (SIDE - 1) as f32 * 6.0 - 3.0;
        Vec3::new(x, y, depth(x, y))
    };
    let positions: Vec<Vec3> = (0..SIDE * SIDE).map(point).collect();
    let mut indices = Vec::new();
    for corner in (0..SIDE * (SIDE - 1)).filter(|i| i % SIDE + 1 < SIDE).map(|i| i as u32) {
        let below = corner + SIDE as u32;
        let side = SIDE as u32;
        indices.extend([corner, corner + 1, below, below, corner + 1, corner + 1 + side]);
    }
    let colors = Colors::Vertex(
        positions.iter().map(|p| [p.x, p.y, p.z].map(|c| c.fract().abs())).collect(),
    );
    Mesh { positions, colors, indices, ..Mesh::default() }
}

#[test]
fn neighbours_neither_gap_nor_overlap() {
    // Flat; with corners on centres of samples and between them, so that edges run through many;
    // and a ground that runs from behind the camera to far outside the guard band.
    let tilt = |_: f32, y: f32| 0.3 - 0.2 * y;
    let mut even = net(|_, _| 1.0);
    even.positions.iter_mut().for_each(|p| *p = (*p * 8.0).round() / 8.0);
    let scenes: [(Mesh, Vec2); 3] = [
        (net(|_, _| 1.5), Vec2::new(50.0, 40.0)),
        (even, Vec2::new(32.0, 16.0)),
        (net(tilt), Vec2::new(40_000.0, 30_000.0)),
    ];
    for (mesh, focal) in scenes {
        let camera =
            Camera { focal, center: Vec2::new(43.25, 38.25), ..camera(UVec2::new(96, 64)) };
        let options =
            SolidRasterOptions { near: 1e-5, samples: 2, ..SolidRasterOptions::default() };
        let mut solid = SolidRasterizer::new();
        let mut covers = vec![0; 4 * 96 * 64];
        for face in 0..mesh.face_count() {
            let mut one = mesh.clone();
            one.select(&[face as u32]);
            let drawn = solid.visibility(&one, &camera, &options);
            covers.iter_mut().zip(&drawn.face).for_each(|(n, f)| *n += usize::from(*f == 0));
        }
        assert!(covers.iter().all(|n| *n == 1), "{:?}", covers.iter().position(|n| *n != 1));
    }
}

#[test]
fn solid_samples_on_an_edge_belong_to_the_lower_right() {
    // Corners on sample centres: a square from (2.5, 2.5) to (6.5, 6.5) holds 4 x 4 samples, not 5
    // x 5.
    let camera = Camera { focal: Vec2::ONE, center: Vec2::ZERO, ..camera(UVec2::splat(10)) };
    let at = |x: f32, y: f32| Vec3::new(x + 0.5, y + 0.5, 1.0);
    let square = |scale: f32| {
        let [a, b, c, d] =
            [at(2.0, 2.0), at(6.0, 2.0), at(6.0, 6.0), at(2.0, 6.0)].map(|v| v * scale);
        vec![[a, b, c], [a, d, c]]
    };
    let mut solid = SolidRasterizer::new();
    let drawn =
        solid.visibility(&mesh(square(1.0)), &camera, &SolidRasterOptions::default()).clone();
    for y in 0..10 {
        for x in 0..10 {
            let inside = (2..6).contains(&x) && (2..6).contains(&y);
            let face = if x >= y { 0 } else { 1 };
            let wanted = if inside { face } else { NO_FACE };
            assert_eq!(drawn.face[(y * 10 + x) as usize], wanted, "{x} {y}");
        }
    }
    // Equal triangles at equal depths: the lower index.
    let twice = [square(1.0), square(1.0), square(0.5)].concat();
    let drawn = solid.visibility(&mesh(twice), &camera, &SolidRasterOptions::default());
    assert!(drawn.face.iter().all(|f| [NO_FACE, 4, 5].contains(f)), "those of half the depth");
    let same = [square(1.0), square(1.0)].concat();
    let drawn = solid.visibility(&mesh(same), &camera, &SolidRasterOptions::default());
    assert!(drawn.face.iter().all(|f| [NO_FACE, 0, 1].contains(f)));
}

#[test]
fn the_picture_is_the_mean_of_its_samples_in_linear_light() {
    let background = [0.2, 0.5, 0.9];
    let meshes = [net(|x, y| 2.0 + x * y), mesh(cloud(15, 200, 4.0, 0.1, 2.0))];
    for mesh in meshes {
        for samples in [1, 2, 4] {
            let camera = camera(UVec2::new(75, 37));
            let options = SolidRasterOptions { background, samples, near: 0.1 };
            let mut solid = SolidRasterizer::new();
            let picture = solid.render(&mesh, &camera, &options);
            assert_eq!((picture.size, picture.alpha.as_ref()), (camera.size, None));
            let drawn = solid.visibility(&mesh, &camera, &options).clone();
            for y in 0..camera.size.y {
                for x in 0..camera.size.x {
                    let got = picture.rgb[(y * camera.size.x + x) as usize];
                    let wanted = mean(&mesh, &camera, &drawn, samples, background, [x, y]);
                    for c in 0..3 {
                        assert!(got[c].abs_diff(wanted[c]) <= 1, "{x} {y}: {got:?} {wanted:?}");
                    }
                }
            }
        }
    }
}

fn mean(
    mesh: &Mesh,
    camera: &Camera,
    drawn: &Visibility,
    samples: u32,
    background: [f32; 3],
    [x, y]: [u32; 2],
) -> [u8; 3] {
    let mut sum = [0.0f64; 3];
    for k in 0..samples * samples {
        let sx = x * samples + k % samples;
        let sy = y * samples + k / samples;
        let face = drawn.face[(sy * drawn.size.x + sx) as usize];
        let weights = barycentrics(drawn, mesh, camera, sx, sy);
        for c in 0..3 {
            sum[c] += match face {
                NO_FACE => f64::from(linear_from_srgb(background[c])),
                _ => {
                    let corners = mesh.corner_colors(face as usize);
                    (0..3).map(|i| f64::from(weights[i]) * f64::from(corners[i][c])).sum()
                }
            };
        }
    }
    sum.map(|s| srgb8_from_linear((s / f64::from(samples * samples)) as f32))
}

#[test]
fn the_picture_does_not_depend_on_the_number_of_threads() {
    let mut corners = cloud(16, 30_000, 4.0, 0.01, 0.1);
    corners.extend(cloud(17, 300, 4.0, 0.1, 4.0));
    // Twice, so that there are ties.
    corners.extend_from_within(..);
    let mesh = mesh(corners);
    let camera = camera(UVec2::new(150, 100));
    let options = SolidRasterOptions { samples: 2, ..SolidRasterOptions::default() };
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut solid = SolidRasterizer::new();
            (
                solid.render(&mesh, &camera, &options),
                solid.visibility(&mesh, &camera, &options).clone(),
            )
        })
    };
    let one = run(1);
    for threads in [2, 3, 7] {
        assert!(one == run(threads), "{threads} threads");
    }
}

#[test]
fn reused_scratch_memory_changes_nothing() {
    let options = SolidRasterOptions { near: 0.05, ..SolidRasterOptions::default() };
    let mut used = SolidRasterizer::new();
    for (name, corners) in scenes() {
        for size in [UVec2::new(40, 90), UVec2::new(130, 20), UVec2::ONE] {
            let mesh = mesh(corners.clone());
            let camera = camera(size);
            let fresh = SolidRasterizer::new().render(&mesh, &camera, &options);
            assert!(used.render(&mesh, &camera, &options) == fresh, "{name}");
        }
    }
}

#[test]
fn options_out_of_range_are_refused() {
    let valid = SolidRasterOptions::default();
    let size = UVec2::new(9000, 20);
    assert!(valid.validate(size).is_ok());
    for wrong in [
        SolidRasterOptions { samples: 3, ..valid },
        SolidRasterOptions { samples: 0, ..valid },
        SolidRasterOptions { samples: 4, ..valid },
        SolidRasterOptions { near: 0.0, ..valid },
        SolidRasterOptions { near: f32::NAN, ..valid },
    ] {
        assert!(wrong.validate(size).is_err(), "{wrong:?}");
    }
}
