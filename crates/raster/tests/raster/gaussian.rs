//! Tests against pictures by brute force in double precision: every Gaussian at every pixel, by the
//! textbook's formulas.

use glam::{DMat2, DMat3, DVec2, DVec3, Mat3, Quat, UVec2, Vec2, Vec3};
use trisplat_raster::gaussian::{GaussianOptions, draw};
use trisplat_scene::{Rng, ScreenFilter, Splats, camera::Camera};

/// A Gaussian on the screen: depth, middle, inverse covariance, opacity, colour.
type Flat = (f64, DVec2, DMat2, f64, DVec3);

fn flatten(splats: &Splats, camera: &Camera, near: f64) -> Vec<Flat> {
    let rotation = camera.rotation.as_dmat3();
    let focal = camera.focal.as_dvec2();
    let eye = -(rotation.transpose() * camera.translation.as_dvec3());
    let guard = camera.size.as_dvec2() / focal * 0.65;
    let mut flat = Vec::new();
    for i in 0..splats.len() {
        let world = splats.positions[i].as_dvec3();
        let at = rotation * (world - eye);
        if at.z < near {
            continue;
        }
        let own = DMat3::from_quat(splats.rotations[i].as_dquat().normalize());
        let squares =
            DMat3::from_diagonal(splats.scales[i].as_dvec3() * splats.scales[i].as_dvec3());
        let solid = rotation * own * squares * own.transpose() * rotation.transpose();
        let t = (at.truncate() / at.z).clamp(-guard, guard);
        let rows = [
            DVec3::new(focal.x, 0.0, -focal.x * t.x) / at.z,
            DVec3::new(0.0, focal.y, -focal.y * t.y) / at.z,
        ];
        let entry = |a: usize, b: usize| rows[a].dot(solid * rows[b]);
        let sharp = DMat2::from_cols_array(&[entry(0, 0), entry(0, 1), entry(1, 0), entry(1, 1)]);
        let blurred = sharp + DMat2::from_diagonal(DVec2::splat(splats.filter.variance.into()));
        let kept = if splats.filter.keeps_light {
            (sharp.determinant().max(0.0) / blurred.determinant()).sqrt()
        } else {
            1.0
        };
        let middle = at.truncate() / at.z * focal + camera.center.as_dvec2();
        let opacity = f64::from(splats.opacity[i]) * kept;
        flat.push((
            at.z,
            middle,
            blurred.inverse(),
            opacity,
            color(splats, i, (world - eye).normalize()),
        ));
    }
    flat.sort_by(|a, b| a.0.total_cmp(&b.0));
    flat
}

/// Degree 0 and 1 by their formulas, higher ones as the kernels' double-precision form has them,
/// which tests of its own check.
fn color(splats: &Splats, i: usize, d: DVec3) -> DVec3 {
    let k = splats.sh_count();
    let basis = trisplat_raster::kernel::sh::basis::<f64>(
        splats.sh_degree,
        trisplat_scene::math::real::V3::new(d.x, d.y, d.z),
    );
    let terms = splats.sh[i * k..(i + 1) * k].iter().zip(basis);
    let sum: DVec3 = terms.map(|(c, b)| Vec3::from(*c).as_dvec3() * b).sum();
    (sum + 0.5).max(DVec3::ZERO)
}

fn brute_force(splats: &Splats, camera: &Camera, options: &GaussianOptions) -> Vec<[f32; 3]> {
    let flat = flatten(splats, camera, options.near.into());
    let mut picture = Vec::new();
    for y in 0..camera.size.y {
        for x in 0..camera.size.x {
            let mut rgb = DVec3::ZERO;
            let mut through = 1.0;
            for (_, middle, inverse, opacity, color) in &flat {
                let d = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5) - *middle;
                let alpha = (opacity * (-0.5 * d.dot(*inverse * d)).exp()).min(0.99);
                if alpha < 1.0 / 255.0 || through < 1e-4 {
                    continue;
                }
                rgb += *color * alpha * through;
                through *= 1.0 - alpha;
            }
            picture.push(
                (rgb + Vec3::from(options.background).as_dvec3() * through).as_vec3().to_array(),
            );
        }
    }
    picture
}

/// Gaussians around the origin, from dots to long needles, of every opacity and SH degree 3.
fn random(count: usize, seed: u64) -> Splats {
    let rng = Rng::new(seed, "gaussians", 0);
    let draw = |i: usize, n: u64| rng.uniform(i as u64 * 64 + n);
    let around = |i: usize, n: u64| Vec3::from([0, 1, 2].map(|k| 2.0 * draw(i, n + k) - 1.0));
    let turn = |i: usize| {
        let q = [3, 4, 5, 6].map(|n| draw(i, n) - 0.5);
        Quat::from_array(q).normalize()
    };
    Splats {
        positions: (0..count).map(|i| around(i, 0) * 1.5).collect(),
        scales: (0..count).map(|i| ((around(i, 7) * 2.5) - 3.0).exp()).collect(),
        rotations: (0..count).map(turn).collect(),
        opacity: (0..count).map(|i| draw(i, 10)).collect(),
        sh: (0..16 * count)
            .map(|j| [0, 1, 2].map(|c| draw(j / 16, 12 + 3 * (j as u64 % 16) + c) - 0.5))
            .collect(),
        sh_degree: 3,
        filter: ScreenFilter::DILATED,
    }
}

fn camera(eye: Vec3, center: Vec2) -> Camera {
    let lens = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::new(70.0, 66.0),
        center,
        size: UVec2::new(83, 61),
    };
    lens.with_look_at(eye, Vec3::ZERO, Vec3::NEG_Y)
}

/// The difference that 99.9% of the numbers of two pictures stay below, and the largest one.
fn differences(a: &[[f32; 3]], b: &[[f32; 3]]) -> (f32, f32) {
    let mut all: Vec<f32> =
        a.iter().flatten().zip(b.iter().flatten()).map(|(a, b)| (a - b).abs()).collect();
    all.sort_by(f32::total_cmp);
    (all[all.len() * 999 / 1000], all[all.len() - 1])
}

#[test]
fn soft_frames_equal_brute_force_from_every_viewpoint() {
    let options = GaussianOptions { background: [0.2, 0.5, 0.9], ..GaussianOptions::default() };
    let middle = Vec2::new(41.5, 30.5);
    let views = [
        camera(Vec3::new(0.5, -1.0, -4.0), middle),
        camera(Vec3::new(3.0, 0.2, 1.0), Vec2::new(10.0, 70.0)),
        camera(Vec3::new(0.1, 0.1, -0.3), Vec2::new(60.0, 12.0)),
    ];
    for (seed, filter) in
        [(1, ScreenFilter::DILATED), (2, ScreenFilter::ANTIALIASED), (3, ScreenFilter::MIP)]
    {
        let splats = Splats { filter, ..random(400, seed) };
        for view in &views {
            let frame = draw(&splats, view, &options);
            let (nearly_all, worst) =
                differences(&frame.rgb, &brute_force(&splats, view, &options));
            assert!(nearly_all < 1e-4 && worst < 1.0 / 255.0, "{filter:?}: {nearly_all} {worst}");
            assert!(frame.transmittance.iter().any(|t| *t < 0.5), "something is seen");
        }
    }
}

#[test]
fn a_disc_and_a_needle_across_the_picture_are_drawn_exactly() {
    let splats = Splats {
        positions: vec![Vec3::new(0.3, 0.2, 0.0), Vec3::new(-0.5, 0.0, 1.0)],
        scales: vec![Vec3::new(0.5, 0.2, 0.0), Vec3::new(40.0, 0.001, 0.001)],
        rotations: vec![Quat::from_rotation_y(1.1), Quat::from_rotation_z(0.4)],
        opacity: vec![1.0, 0.7],
        sh: vec![[1.0, 0.2, -1.0], [-1.0, 1.0, 0.5]],
        ..Splats::default()
    };
    let view = camera(Vec3::new(0.0, 0.0, -3.0), Vec2::new(40.0, 30.0));
    let options = GaussianOptions::default();
    let frame = draw(&splats, &view, &options);
    let (_, worst) = differences(&frame.rgb, &brute_force(&splats, &view, &options));
    assert!(worst < 2e-4, "{worst}");
}

#[test]
fn solid_pictures_are_equal_on_any_number_of_threads() {
    let mut splats = random(3000, 4);
    // All at one depth: what lies in front is what comes first in the file.
    splats.positions.iter_mut().for_each(|p| p.z = 0.0);
    let view = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::Z * 3.0,
        ..camera(Vec3::X, Vec2::splat(30.0))
    };
    let with = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a pool");
        pool.install(|| draw(&splats, &view, &GaussianOptions::default()))
    };
    assert_eq!(with(1), with(3));
    let (nearly_all, _) =
        differences(&with(2).rgb, &brute_force(&splats, &view, &GaussianOptions::default()));
    assert!(nearly_all < 1.0 / 255.0, "{nearly_all}");
}

#[test]
fn nothing_in_view_is_the_background() {
    let view = camera(Vec3::new(0.0, 0.0, -3.0), Vec2::splat(30.0));
    let options = GaussianOptions { background: [0.1, 0.2, 0.3], ..GaussianOptions::default() };
    let mut behind = random(50, 5);
    behind.positions.iter_mut().for_each(|p| p.z -= 9.0);
    for splats in [Splats::default(), behind] {
        let frame = draw(&splats, &view, &options);
        assert!(frame.rgb.iter().all(|rgb| *rgb == options.background));
    }
}
