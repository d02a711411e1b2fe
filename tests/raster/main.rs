//! Whole frames and gradients against the brute-force oracle; the same bits for any number of threads;
//! hostile scenes.

#![allow(clippy::print_stderr, reason = "prints the largest error it found")]

#[path = "../common/mod.rs"]
mod common;
mod solid;

use common::dual::Dual;
use common::oracle::{self, Eye, Number, Pixel, Rules, Triangle};
use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat::camera::Camera;
use trisplat::math::real::Real;
use trisplat::raster::soft::Importance;
use trisplat::raster::soft::{Frame, FrameGrad, Soft, SoftOptions, Sort, SoupGrad, SoupRef, Window};
use trisplat::rng::Rng;
use trisplat::soup::Soup;

/// Pixels nearer than this to a jump or kink of the oracle are not compared.
const MARGIN: f64 = 2e-4;

fn random_soup(seed: u64, count: usize, degree: u8) -> Soup {
    let k = (degree as usize + 1).pow(2);
    let mut soup = Soup { sh_degree: degree, ..Soup::default() };
    for i in 0..count {
        let rng = Rng::new(seed, "soup", i as u64);
        let at = |n: u64, lo: f32, hi: f32| lo + (hi - lo) * rng.uniform(n);
        let center = Vec3::new(at(0, -1.2, 1.2), at(1, -1.0, 1.0), at(2, 2.5, 6.0));
        let size = 10f32.powf(at(3, -0.9, 0.3));
        let corner =
            |n: u64| center + size * Vec3::new(at(n, -1.0, 1.0), at(n + 1, -1.0, 1.0), at(n + 2, -0.6, 0.6));
        soup.vertices.push([corner(4), corner(7), corner(10)]);
        soup.opacity.push(at(13, 0.1, 1.0));
        soup.sigma.push(10f32.powf(at(14, -1.5, 0.8)));
        for n in 0..k as u64 {
            let scale = if n == 0 { 1.2 } else { 0.3 };
            soup.sh.push([0, 1, 2].map(|c| at(20 + 3 * n + c, -scale, scale)));
        }
    }
    soup
}

fn camera(size: [u32; 2]) -> Camera {
    let rotation = Mat3::from_rotation_y(0.2) * Mat3::from_rotation_x(-0.1);
    let focal = 0.9 * size[0] as f32;
    Camera {
        rotation,
        translation: Vec3::new(0.3, -0.1, 0.4),
        focal: Vec2::new(focal, focal * 1.1),
        center: Vec2::new(0.47, 0.52) * Vec2::new(size[0] as f32, size[1] as f32),
        size: UVec2::from_array(size),
    }
}

fn eye(c: &Camera) -> Eye {
    let d = |x: f32| f64::from(x);
    let m = c.rotation;
    Eye {
        rotation: [0, 1, 2].map(|i| [0, 1, 2].map(|j| d(m.col(j)[i]))),
        translation: c.translation.to_array().map(d),
        focal: c.focal.to_array().map(d),
        center: c.center.to_array().map(d),
        size: [c.size.x as usize, c.size.y as usize],
    }
}

fn rules(o: &SoftOptions) -> Rules {
    Rules {
        background: o.background.map(f64::from),
        per_pixel: o.sort == Sort::Pixel,
        cap: f64::from(o.alpha_cap),
        cutoff: f64::from(o.cutoff),
        min_transmittance: f64::from(o.min_transmittance),
        near: f64::from(o.near),
        fade_px: f64::from(o.fade_px),
        depth_range: o.depth_range.map(f64::from),
        coverage: match o.window {
            Window::Soft | Window::Sigmoid => None,
            Window::Coverage { width_px } => Some(f64::from(width_px)),
        },
        sigmoid: o.window == Window::Sigmoid,
        linear: o.linear,
    }
}

fn options() -> SoftOptions {
    SoftOptions {
        background: [0.2, 0.5, 0.9],
        geometry: true,
        importance: true,
        ratio_least: 0.0,
        near: 0.4,
        ..SoftOptions::default()
    }
}

/// The triangles of a soup as numbers of the oracle; parameters of triangle `seeded` are variables.
fn triangles<R: Real>(soup: &Soup, seeded: usize, variable: impl Fn(f64, usize) -> R) -> Vec<Triangle<R>> {
    let k = soup.sh_count();
    (0..soup.len())
        .map(|i| {
            let of =
                |x: f32, n: usize| if i == seeded { variable(f64::from(x), n) } else { R::of(f64::from(x)) };
            let v = soup.vertices[i];
            Triangle {
                vertices: [0, 1, 2].map(|c| [0, 1, 2].map(|a| of(v[c][a], 3 * c + a))),
                opacity: of(soup.opacity[i], 9),
                sigma: of(soup.sigma[i], 10),
                sh: (0..k).map(|n| [0, 1, 2].map(|c| of(soup.sh[i * k + n][c], 11 + 3 * n + c))).collect(),
            }
        })
        .collect()
}

fn plain(soup: &Soup) -> Vec<Triangle<f64>> {
    triangles(soup, usize::MAX, |x, _| x)
}

/// What a frame and the oracle both have, pixel by pixel: rgb, T, depth, median, normal, distortion.
fn frame_values(f: &Frame, i: usize) -> [f64; 10] {
    let [r, g, b] = f.rgb[i];
    let [x, y, z] = f.normal[i];
    [r, g, b, f.transmittance[i], f.depth[i], f.median_depth[i], x, y, z, f.distortion[i]].map(f64::from)
}

fn pixel_values<R: Number>(p: &Pixel<R>) -> [R; 10] {
    let ([r, g, b], [x, y, z]) = (p.rgb, p.normal);
    [r, g, b, p.transmittance, p.depth, p.median, x, y, z, p.distortion]
}

const NAMES: [&str; 10] = ["r", "g", "b", "T", "depth", "median", "nx", "ny", "nz", "distortion"];

/// Compares a frame with the oracle; gives the largest error and the share of pixels left out.
fn compare(soup: &Soup, camera: &Camera, options: &SoftOptions, tolerance: f64) -> (f64, f64) {
    let mut soft = Soft::new();
    let frame = soft.render(&SoupRef::from(soup), camera, options).clone();
    let picture = oracle::render(&plain(soup), &eye(camera), &rules(options));
    let (mut worst, mut left_out) = (0.0f64, 0);
    for (i, pixel) in picture.iter().enumerate() {
        if pixel.margin < MARGIN {
            left_out += 1;
            continue;
        }
        for ((got, want), name) in frame_values(&frame, i).into_iter().zip(pixel_values(pixel)).zip(NAMES) {
            let error = (got - want).abs() / want.abs().max(1.0);
            assert!(error < tolerance, "{name} of pixel {i}: {got} instead of {want}");
            worst = worst.max(error);
        }
    }
    compare_importance(soup, &soft, &picture);
    (worst, f64::from(left_out) / picture.len() as f64)
}

fn compare_importance(soup: &Soup, soft: &Soft, picture: &[Pixel<f64>]) {
    let mut importance = Importance::new(soup.len());
    soft.accumulate_importance(&mut importance);
    for t in 0..soup.len() {
        let weights = || picture.iter().map(|p| p.weights[t]);
        let (sum, max) = (weights().sum::<f64>(), weights().fold(0.0, f64::max));
        assert!(
            (f64::from(importance.sum_weight[t]) - sum).abs() < 1e-3 * sum.max(1.0) + 0.02,
            "triangle {t}"
        );
        assert!((f64::from(importance.max_weight[t]) - max).abs() < 5e-3, "triangle {t}");
        let pixels = weights().filter(|w| *w > 0.0).count() as i64;
        assert!((i64::from(importance.pixels[t]) - pixels).abs() <= 1 + pixels / 100, "triangle {t}");
    }
}

#[test]
fn frames_equal_the_oracle() {
    for (seed, sort, cap, size) in [
        (1, Sort::Tile, 0.99, [37, 29]),
        (2, Sort::Tile, 1.0, [16, 48]),
        (3, Sort::Pixel, 0.99, [37, 29]),
        (4, Sort::Pixel, 1.0, [20, 20]),
        (5, Sort::Tile, 0.99, [1, 1]),
    ] {
        let o = SoftOptions { sort, alpha_cap: cap, ..options() };
        let (worst, left_out) = compare(&random_soup(seed, 40, (seed % 4) as u8), &camera(size), &o, 2e-4);
        eprintln!(
            "seed {seed}: largest error {worst:.1e}, {:.1}% of the pixels near a jump",
            left_out * 100.0
        );
        assert!(left_out < 0.15);
    }
}

#[test]
fn triangles_across_the_near_plane_are_cut() {
    let mut soup = random_soup(6, 30, 1);
    for (i, v) in soup.vertices.iter_mut().enumerate() {
        // One or two corners behind the camera.
        v[0].z = -1.0 - i as f32 * 0.1;
        if i % 2 == 0 {
            v[1].z = -0.5;
        }
    }
    let (worst, _) = compare(&soup, &camera([37, 29]), &options(), 2e-3);
    eprintln!("largest error {worst:.1e}");
    let frame = Soft::new().render(&SoupRef::from(&soup), &camera([37, 29]), &options()).clone();
    assert!(frame.transmittance.iter().filter(|t| **t < 0.9).count() > 200);
}

/// A random gradient of a frame, zero near jumps.
fn random_grad(seed: u64, picture: &[Pixel<f64>], geometry: bool) -> FrameGrad {
    let mut d = FrameGrad::default();
    for (i, pixel) in picture.iter().enumerate() {
        let rng = Rng::new(seed, "grad", i as u64);
        let keep = if pixel.margin < MARGIN { 0.0 } else { 1.0 };
        let at = |n: u64| (rng.uniform(n) - 0.5) * keep;
        d.d_rgb.push([at(0), at(1), at(2)]);
        d.d_transmittance.push(at(3));
        if geometry {
            d.d_depth.push(at(4));
            d.d_median_depth.push(at(5));
            d.d_normal.push([at(6), at(7), at(8)]);
            d.d_distortion.push(at(9));
        }
    }
    d
}

fn grad_values(d: &FrameGrad, i: usize) -> [f64; 10] {
    let scalar = |v: &[f32]| v.get(i).copied().unwrap_or(0.0);
    let [r, g, b] = d.d_rgb[i];
    let [x, y, z] = d.d_normal.get(i).copied().unwrap_or_default();
    let (t, depth) = (scalar(&d.d_transmittance), scalar(&d.d_depth));
    [r, g, b, t, depth, scalar(&d.d_median_depth), x, y, z, scalar(&d.d_distortion)].map(f64::from)
}

/// Parameters of a triangle of SH degree 3.
const PARAMETERS: usize = 11 + 48;

/// The gradient of triangle `t` by dual numbers.
fn exact_grad(soup: &Soup, t: usize, camera: &Camera, options: &SoftOptions, d: &FrameGrad) -> Vec<f64> {
    let scene = triangles(soup, t, Dual::<PARAMETERS>::variable);
    let picture = oracle::render(&scene, &eye(camera), &rules(options));
    let mut out = vec![0.0; 11 + 3 * soup.sh_count()];
    for (i, pixel) in picture.iter().enumerate() {
        for (value, weight) in pixel_values(pixel).into_iter().zip(grad_values(d, i)) {
            for (out, slope) in out.iter_mut().zip(value.d) {
                *out += slope * weight;
            }
        }
    }
    out
}

fn soup_grad(g: &SoupGrad, t: usize, k: usize) -> Vec<f64> {
    let vertices = g.vertices[t].iter().flat_map(|v| v.to_array());
    let sh = g.sh[t * k..(t + 1) * k].iter().flatten().copied();
    vertices.chain([g.opacity[t], g.sigma[t]]).chain(sh).map(f64::from).collect()
}

/// Largest error of a gradient, each group (vertices, opacity, σ, SH) relative to its largest entry.
fn compare_grads(soup: &Soup, camera: &Camera, options: &SoftOptions, seed: u64) -> f64 {
    let picture = oracle::render(&plain(soup), &eye(camera), &rules(options));
    let d = random_grad(seed, &picture, options.geometry);
    let mut soft = Soft::new();
    let mut grad = SoupGrad::default();
    soft.render(&SoupRef::from(soup), camera, options);
    soft.backward(&SoupRef::from(soup), camera, options, &d, &mut grad);
    assert_eq!(grad.dropped, 0);
    let k = soup.sh_count();
    let all: Vec<_> =
        (0..soup.len()).map(|t| (exact_grad(soup, t, camera, options, &d), soup_grad(&grad, t, k))).collect();
    let mut worst = 0.0f64;
    for (name, range) in [("vertices", 0..9), ("opacity", 9..10), ("sigma", 10..11), ("sh", 11..11 + 3 * k)] {
        if name == "sigma" && matches!(options.window, Window::Coverage { .. }) {
            assert!(all.iter().all(|(_, got)| got[10] == 0.0));
            continue;
        }
        let size = all.iter().flat_map(|(e, _)| &e[range.clone()]).fold(0.0f64, |m, x| m.max(x.abs()));
        assert!(size > 0.0, "nothing to compare");
        for (t, (exact, got)) in all.iter().enumerate() {
            for n in range.clone() {
                let own = exact[range.clone()].iter().fold(0.0f64, |m, x| m.max(x.abs()));
                let error = (exact[n] - got[n]).abs() / own.max(0.02 * size);
                assert!(error < 2e-3, "{name} of {t}, entry {n}: {} instead of {}", got[n], exact[n]);
                worst = worst.max(error);
            }
        }
    }
    worst
}

#[test]
fn gradients_equal_dual_numbers_through_the_oracle() {
    for (seed, sort, cap, geometry) in [
        (11, Sort::Tile, 0.99, false),
        (12, Sort::Tile, 1.0, true),
        (13, Sort::Pixel, 0.99, true),
        (14, Sort::Tile, 0.6, true),
    ] {
        let o = SoftOptions { sort, alpha_cap: cap, geometry, ..options() };
        let soup = random_soup(seed, if sort == Sort::Pixel { 40 } else { 12 }, (seed % 4) as u8);
        let worst = compare_grads(&soup, &camera([33, 21]), &o, seed);
        eprintln!("seed {seed}: largest relative error {worst:.1e}");
    }
}

/// Opaque triangles as an engine covers pixels, in its order and light.
fn engine(width_px: f32, sort: Sort, cap: f32) -> SoftOptions {
    SoftOptions {
        window: Window::Coverage { width_px },
        sort,
        alpha_cap: cap,
        linear: true,
        geometry: false,
        ..options()
    }
}

#[test]
fn covered_frames_and_gradients_equal_the_oracle() {
    for (seed, sort, cap, width_px) in
        [(41, Sort::Tile, 1.0, 1.0), (42, Sort::Pixel, 1.0, 1.0), (43, Sort::Pixel, 0.995, 2.5)]
    {
        let mut soup = random_soup(seed, 30, (seed % 4) as u8);
        if cap == 1.0 {
            soup.opacity.fill(1.0);
        }
        let o = engine(width_px, sort, cap);
        let (worst, left_out) = compare(&soup, &camera([37, 29]), &SoftOptions { geometry: true, ..o }, 5e-4);
        eprintln!("seed {seed}: largest error {worst:.1e}, {:.1}% near a jump", left_out * 100.0);
        assert!(left_out < 0.3);
        // Opacity has no meaning where the last layer is opaque: only soft ones are compared. Nor are colours
        // above 1, at which the gradient passes the clamp.
        soup.opacity.iter_mut().for_each(|o| *o = o.min(0.97));
        soup.sh.as_flattened_mut().iter_mut().for_each(|c| *c *= 0.5);
        let worst = compare_grads(&soup, &camera([33, 21]), &SoftOptions { alpha_cap: 0.98, ..o }, seed);
        eprintln!("seed {seed}: largest relative error {worst:.1e}");
    }
}

#[test]
fn frames_and_gradients_with_a_sigmoid_window_equal_the_oracle() {
    for seed in [51, 52, 53] {
        let soup = random_soup(seed, 20, (seed % 4) as u8);
        // Depth has no meaning outside the edges, so only light is compared.
        let o = SoftOptions { window: Window::Sigmoid, geometry: false, importance: false, ..options() };
        let camera = camera([37, 29]);
        let frame = Soft::new().render(&SoupRef::from(&soup), &camera, &o).clone();
        let picture = oracle::render(&plain(&soup), &eye(&camera), &rules(&o));
        let sound: Vec<usize> = (0..picture.len()).filter(|&i| picture[i].margin >= MARGIN).collect();
        assert!(sound.len() * 10 > picture.len() * 7, "{} of {}", sound.len(), picture.len());
        for i in sound {
            let ([r, g, b], [x, y, z]) = (frame.rgb[i], picture[i].rgb);
            let got = [r, g, b, frame.transmittance[i]].map(f64::from);
            let wants = [x, y, z, picture[i].transmittance];
            let near = got.iter().zip(wants).all(|(got, want)| (got - want).abs() < 5e-4);
            assert!(near, "pixel {i}: {got:?} instead of {wants:?}");
        }
        let worst = compare_grads(&soup, &self::camera([33, 21]), &o, seed);
        eprintln!("seed {seed}: largest relative error {worst:.1e}");
    }
}

#[test]
fn coverage_approaches_the_share_of_samples() {
    // Large and small triangles, and slivers, against 16 x 16 point samples a pixel.
    let mut soup = random_soup(44, 60, 0);
    soup.opacity.fill(1.0);
    soup.sigma.fill(1e-4);
    let small = camera([40, 30]);
    let fine = small.resized(small.size * 16);
    let o = SoftOptions { linear: false, importance: false, ..engine(1.0, Sort::Pixel, 1.0) };
    let points = SoftOptions { window: Window::Soft, fade_px: 0.0, ..o };
    let covered = Soft::new().render(&SoupRef::from(&soup), &small, &o).clone();
    let sampled = Soft::new().render(&SoupRef::from(&soup), &fine, &points).clone();
    let mut square = 0.0;
    for (i, got) in covered.rgb.iter().enumerate() {
        let (x, y) = (i % 40 * 16, i / 40 * 16);
        for (c, got) in got.iter().enumerate() {
            let at = |k: usize| sampled.rgb[(y + k / 16) * 640 + x + k % 16][c];
            let mean = (0..256).map(at).sum::<f32>() / 256.0;
            square += f64::from(got - mean).powi(2);
        }
    }
    let rms = (square / (3.0 * covered.rgb.len() as f64)).sqrt();
    eprintln!("coverage against samples: {rms:.4} rms");
    assert!(rms < 0.03, "{rms}");
}

#[test]
fn gradients_of_cut_and_tiny_triangles_are_exact() {
    let mut soup = random_soup(15, 12, 1);
    for (i, v) in soup.vertices.iter_mut().enumerate() {
        if i % 2 == 0 {
            v[i % 3].z = -0.7;
        } else {
            // Inradius of a fraction of a pixel: in the fade.
            let center = (v[0] + v[1] + v[2]) / 3.0;
            let size = (v[1] - v[0]).length().max((v[2] - v[0]).length());
            *v = v.map(|p| center + (p - center) * (0.25 / size));
        }
    }
    let o = SoftOptions { fade_px: 3.0, ..options() };
    let worst = compare_grads(&soup, &camera([33, 21]), &o, 15);
    eprintln!("largest relative error {worst:.1e}");
}

fn grads(soup: &Soup, camera: &Camera, options: &SoftOptions, threads: usize) -> (Frame, SoupGrad) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    pool.install(|| {
        let mut soft = Soft::new();
        let frame = soft.render(&SoupRef::from(soup), camera, options).clone();
        let count = frame.rgb.len();
        let d = FrameGrad {
            d_rgb: (0..count).map(|i| [0.5, -0.25, (i % 7) as f32 * 0.1]).collect(),
            d_distortion: vec![0.3; if options.geometry { count } else { 0 }],
            ..FrameGrad::default()
        };
        let mut grad = SoupGrad::default();
        soft.backward(&SoupRef::from(soup), camera, options, &d, &mut grad);
        (frame, grad)
    })
}

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let soup = random_soup(21, 5000, 2);
    let solid = engine(1.0, Sort::Pixel, 1.0);
    for o in [options(), SoftOptions { sort: Sort::Pixel, ..options() }, solid] {
        let one = grads(&soup, &camera([150, 90]), &o, 1);
        for threads in [2, 3, 8] {
            assert!(one == grads(&soup, &camera([150, 90]), &o, threads), "{o:?}, {threads} threads");
        }
    }
}

#[test]
fn scratch_memory_holds_nothing_back() {
    let (a, b) = (random_soup(22, 300, 1), random_soup(23, 200, 1));
    let (wide, tall) = (camera([60, 40]), camera([20, 70]));
    let o = options();
    let mut soft = Soft::new();
    let mut grad = SoupGrad::default();
    for (soup, camera) in [(&a, &wide), (&b, &tall), (&a, &tall), (&a, &wide)] {
        let reused = soft.render(&SoupRef::from(soup), camera, &o).clone();
        let d = FrameGrad { d_rgb: vec![[1.0, 0.5, -0.5]; reused.rgb.len()], ..FrameGrad::default() };
        soft.backward(&SoupRef::from(soup), camera, &o, &d, &mut grad);
        let (mut fresh, mut fresh_grad) = (Soft::new(), SoupGrad::default());
        assert!(reused == *fresh.render(&SoupRef::from(soup), camera, &o));
        fresh.backward(&SoupRef::from(soup), camera, &o, &d, &mut fresh_grad);
        assert!(grad == fresh_grad);
    }
}

#[test]
fn rows_of_unseen_triangles_are_zero_and_visible_lists_the_others() {
    let soup = random_soup(24, 400, 1);
    let (_, grad) = grads(&soup, &camera([50, 40]), &options(), 1);
    assert!(grad.visible.windows(2).all(|w| w[0] < w[1]) && grad.visible.len() > 50);
    for t in 0..soup.len() {
        let zero = soup_grad(&grad, t, soup.sh_count()).iter().all(|x| *x == 0.0);
        assert!(zero || grad.visible.binary_search(&(t as u32)).is_ok());
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
        };
        let straight = Camera { rotation: Mat3::IDENTITY, translation: Vec3::ZERO, ..camera([21, 21]) };
        let o = SoftOptions { alpha_cap: 1.0, background: [0.0; 3], sort, ..options() };
        let frame = Soft::new().render(&SoupRef::from(&soup), &straight, &o).clone();
        assert!(frame.rgb[10 * 21 + 10][0] > 0.99, "{sort:?}");
    }
}

#[test]
fn tiny_triangles_fade_and_do_not_vanish() {
    let camera = Camera { rotation: Mat3::IDENTITY, translation: Vec3::ZERO, ..camera([21, 21]) };
    // One corner on each side of the centre pixel's centre, at ever smaller sizes.
    let z = 3.0;
    let to_world = |x: f32, y: f32| {
        Vec3::new((x - camera.center.x) / camera.focal.x * z, (y - camera.center.y) / camera.focal.y * z, z)
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
        };
        let frame = Soft::new().render(&SoupRef::from(&soup), &camera, &options()).clone();
        let alpha = 1.0 - frame.transmittance[10 * 21 + 10];
        assert!(alpha <= last + 1e-4 && last - alpha < 0.2, "at {r} px: {last} to {alpha}");
        last = alpha;
    }
    assert_eq!(last, 0.0);
}

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
        ("slivers", with(&|i, v, _, _| v[2] = (v[0] + v[1]) * 0.5 + Vec3::X * 10f32.powi(-(i as i32 % 12)))),
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
        for (sort, exact_incenter) in [(Sort::Tile, true), (Sort::Tile, false), (Sort::Pixel, true)] {
            for (size, cap, near) in [([37, 29], 0.99, 0.01), ([1, 1], 1.0, 1e-6), ([16, 5], 1.0, 1e-30)] {
                for ratio_least in [0.0, 1e-3] {
                    let o =
                        SoftOptions { sort, exact_incenter, alpha_cap: cap, near, ratio_least, ..options() };
                    let (frame, grad) = grads(&soup, &camera(size), &o, 1);
                    let finite = |v: &[f32]| v.iter().all(|x| x.is_finite());
                    let colors = frame.rgb.as_flattened().iter().chain(frame.normal.as_flattened());
                    assert!(colors.copied().all(f32::is_finite), "{name} {o:?}");
                    assert!(finite(&frame.transmittance) && finite(&frame.distortion), "{name} {o:?}");
                    assert!(finite(&frame.depth) && finite(&frame.median_depth), "{name} {o:?}");
                    assert!(finite(&grad.opacity) && finite(&grad.sigma), "{name} {o:?}");
                    assert!(grad.vertices.as_flattened().iter().all(|v| v.is_finite()), "{name} {o:?}");
                    assert!(finite(grad.sh.as_flattened()), "{name} {o:?}");
                    let tame = ["sigma", "opacity", "points", "behind", "all equal"]
                        .iter()
                        .any(|n| name.starts_with(n));
                    assert!(!tame || grad.dropped == 0, "{name}: {} gradients dropped", grad.dropped);
                }
            }
        }
    }
}

#[test]
fn a_scaled_scene_looks_the_same() {
    let soup = random_soup(41, 200, 2);
    let camera = camera([64, 48]);
    let o = SoftOptions { geometry: false, ..options() };
    let frame = Soft::new().render(&SoupRef::from(&soup), &camera, &o).clone();
    for scale in [1e-4f32, 1e4, 1.0 / 1024.0] {
        let mut moved = soup.clone();
        moved.vertices.iter_mut().for_each(|v| *v = v.map(|p| p * scale));
        let camera = Camera { translation: camera.translation * scale, ..camera };
        let o = SoftOptions { near: o.near * scale, ..o };
        let other = Soft::new().render(&SoupRef::from(&moved), &camera, &o).clone();
        let differs = |a: &[f32; 3], b: &[f32; 3]| (0..3).any(|c| (a[c] - b[c]).abs() > 1e-4);
        let count = frame.rgb.iter().zip(&other.rgb).filter(|(a, b)| differs(a, b)).count();
        // A faint rim pixel may fall to either side of the cutoff.
        assert!(count <= 3, "{scale}: {count} pixels differ");
    }
}
