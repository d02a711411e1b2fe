//! Scenes that break rasterisers.

use super::scenes::{Outputs, camera, draw, options, random_soup};
use glam::{Mat3, Vec3};
use trisplat_raster::soft::{SoftOptions, SoftRasterizer, Sort, SoupRef};
use trisplat_scene::{Soup, camera::Camera};

/// Changes one triangle: its number, corners, opacity and σ.
type Change<'a> = &'a dyn Fn(usize, &mut [Vec3; 3], &mut f32, &mut f32);

/// Scenes that break rasterisers.
fn hostile() -> Vec<(&'static str, Soup)> {
    let base = random_soup(31, 60, 3);
    let with = |f: Change<'_>| {
        let mut soup = base.clone();
        for i in 0..soup.len() {
            f(i, &mut soup.vertices[i], &mut soup.opacity[i], &mut soup.sigma[i]);
        }
        soup
    };
    let scaled = |s: f32| with(&|_, v, _, _| *v = v.map(|p| p * s));
    vec![
        ("empty", Soup { sh_degree: 3, ..Soup::default() }),
        ("points", with(&|_, v, _, _| *v = [v[0]; 3])),
        ("segments", with(&|_, v, _, _| v[2] = v[0] + (v[1] - v[0]) * 0.3)),
        ("two equal corners", with(&|i, v, _, _| v[i % 3] = v[(i + 1) % 3])),
        (
            "slivers",
            with(&|i, v, _, _| v[2] = (v[0] + v[1]) * 0.5 + Vec3::X * 10f32.powi(-(i as i32 % 12))),
        ),
        ("edge on", with(&|_, v, _, _| v[2] = v[0] * 1.5)),
        ("through the camera", with(&|i, v, _, _| v[i % 3] = Vec3::new(-0.3, 0.1, -0.4))),
        ("corners on the near plane", with(&|i, v, _, _| v[i % 3].z = 0.0)),
        ("behind", with(&|_, v, _, _| *v = v.map(|p| -p))),
        ("sigma 1e-4", with(&|_, _, _, s| *s = 1e-4)),
        ("sigma 1e3", with(&|_, _, _, s| *s = 1e3)),
        ("sigma spread", with(&|i, _, _, s| *s = 10f32.powi(i as i32 % 8 - 4))),
        ("opacity 0", with(&|_, _, o, _| *o = 0.0)),
        ("opacity 1", with(&|_, _, o, s| (*o, *s) = (1.0, 1e-4))),
        ("huge", with(&|_, v, _, _| *v = v.map(|p| (p - Vec3::Z * 4.0) * 1e4 + Vec3::Z * 4.0))),
        ("a thousandth of a pixel", with(&|_, v, _, _| *v = v.map(|p| v[0] + (p - v[0]) * 1e-5))),
        ("scale 1e4", scaled(1e4)),
        ("scale 1e-4", scaled(1e-4)),
        ("scale 1e18", scaled(1e18)),
        ("scale 1e30", scaled(1e30)),
        ("scale 1e-30", scaled(1e-30)),
        ("offset 1e6", with(&|_, v, _, _| *v = v.map(|p| p + Vec3::splat(1e6)))),
        (
            "not numbers",
            with(&|i, v, o, s| match i % 5 {
                0 => v[i % 3].x = f32::NAN,
                1 => v[i % 3].z = f32::INFINITY,
                2 => *o = f32::NAN,
                3 => *s = f32::NAN,
                _ => v[i % 3].y = f32::NEG_INFINITY,
            }),
        ),
        ("all equal", with(&|_, v, _, _| *v = base.vertices[0])),
    ]
}

#[test]
fn hostile_scenes_stay_finite() {
    for (name, soup) in hostile() {
        for sort in [Sort::Tile, Sort::Pixel] {
            for (size, cap, near) in
                [([37, 29], 0.99, 0.01), ([1, 1], 1.0, 1e-6), ([16, 5], 1.0, 1e-30)]
            {
                for min_ratio in [0.0, 1e-3] {
                    let o = SoftOptions { sort, alpha_cap: cap, near, min_ratio, ..options() };
                    let Outputs { frame, grad, .. } = draw(&soup, &camera(size), &o, 1);
                    let finite = |v: &[f32]| v.iter().all(|x| x.is_finite());
                    let colors = frame.rgb.as_flattened().iter().chain(frame.normal.as_flattened());
                    assert!(colors.copied().all(f32::is_finite), "{name} {o:?}");
                    assert!(
                        finite(&frame.transmittance) && finite(&frame.distortion),
                        "{name} {o:?}"
                    );
                    assert!(finite(&frame.depth) && finite(&frame.median_depth), "{name} {o:?}");
                    assert!(finite(&grad.opacity) && finite(&grad.sigma), "{name} {o:?}");
                    assert!(
                        grad.vertices.as_flattened().iter().all(|v| v.is_finite()),
                        "{name} {o:?}"
                    );
                    assert!(finite(grad.sh.as_flattened()), "{name} {o:?}");
                    let tame = ["sigma", "opacity", "points", "behind", "all equal"]
                        .iter()
                        .any(|n| name.starts_with(n));
                    assert!(
                        !tame || grad.dropped == 0,
                        "{name}: {} gradients dropped",
                        grad.dropped
                    );
                }
            }
        }
    }
}

#[test]
fn equal_depths_are_drawn_by_index() {
    let v = [Vec3::new(-1.0, -1.0, 3.0), Vec3::new(1.0, -1.0, 3.0), Vec3::new(0.0, 1.0, 3.0)];
    let color = |r: f32| [[r, 0.0, 0.0].map(|c| (c - 0.5) / 0.282_094_8)];
    for sort in [Sort::Tile, Sort::Pixel] {
        let soup = Soup {
            vertices: vec![v, v],
            opacity: vec![1.0; 2],
            sigma: vec![1e-4; 2],
            sh: [color(1.0), color(0.0)].concat(),
            sh_degree: 0,
            ..Soup::default()
        };
        let straight =
            Camera { rotation: Mat3::IDENTITY, translation: Vec3::ZERO, ..camera([21, 21]) };
        let o = SoftOptions { alpha_cap: 1.0, background: [0.0; 3], sort, ..options() };
        let frame = SoftRasterizer::new().render(&SoupRef::from(&soup), &straight, &o).clone();
        assert!(frame.rgb[10 * 21 + 10][0] > 0.99, "{sort:?}");
    }
}

#[test]
fn tiny_triangles_fade_and_do_not_vanish() {
    let camera = Camera { rotation: Mat3::IDENTITY, translation: Vec3::ZERO, ..camera([21, 21]) };
    // One corner on each side of the centre pixel's centre, at ever smaller sizes.
    let z = 3.0;
    let to_world = |x: f32, y: f32| {
        Vec3::new(
            (x - camera.center.x) / camera.focal.x * z,
            (y - camera.center.y) / camera.focal.y * z,
            z,
        )
    };
    let mut last = 1.0;
    for step in 0..60 {
        let r = 2.0 * 0.9f32.powi(step);
        let corner = |a: f32| to_world(10.5 + r * a.cos(), 10.5 + r * a.sin());
        let soup = Soup {
            vertices: vec![[corner(0.1), corner(2.2), corner(4.3)]],
            opacity: vec![0.9],
            sigma: vec![0.5],
            sh: vec![[0.0; 3]],
            sh_degree: 0,
            ..Soup::default()
        };
        let frame =
            SoftRasterizer::new().render(&SoupRef::from(&soup), &camera, &options()).clone();
        let alpha = 1.0 - frame.transmittance[10 * 21 + 10];
        assert!(alpha <= last + 1e-4 && last - alpha < 0.2, "at {r} px: {last} to {alpha}");
        last = alpha;
    }
    assert_eq!(last, 0.0);
}

#[test]
fn a_scaled_scene_looks_the_same() {
    let soup = random_soup(41, 200, 2);
    let camera = camera([64, 48]);
    let o = SoftOptions { geometry: false, ..options() };
    let frame = SoftRasterizer::new().render(&SoupRef::from(&soup), &camera, &o).clone();
    for scale in [1e-4f32, 1e4, 1.0 / 1024.0, 1e-25, 1e25] {
        let mut moved = soup.clone();
        moved.vertices.iter_mut().for_each(|v| *v = v.map(|p| p * scale));
        let camera = Camera { translation: camera.translation * scale, ..camera };
        let o = SoftOptions { near: o.near * scale, ..o };
        let other = SoftRasterizer::new().render(&SoupRef::from(&moved), &camera, &o).clone();
        let differs = |a: &[f32; 3], b: &[f32; 3]| (0..3).any(|c| (a[c] - b[c]).abs() > 1e-4);
        let count = frame.rgb.iter().zip(&other.rgb).filter(|(a, b)| differs(a, b)).count();
        // A faint rim pixel may fall to either side of the cutoff.
        assert!(count <= 3, "{scale}: {count} pixels differ");
    }
}
