//! Compares frames and gradients with the brute-force oracle.

use trisplat_oracle::exact::{exact_grad, oracle_camera, pixel_values, plain, rules, soup_grad};
use trisplat_oracle::frame::{self as oracle, Pixel};
use trisplat_raster::soft::{
    Frame, FrameGrad, Importance, SoftOptions, SoftRasterizer, SoupGrad, SoupRef, Window,
};
use trisplat_scene::{Rng, Soup, camera::Camera};

/// Pixels nearer than this to a jump or kink of the oracle are not compared.
pub(crate) const MARGIN: f64 = 2e-4;

/// Values of a frame and of the oracle, pixel by pixel: rgb, T, depth, median, normal,
/// distortion.
pub(crate) fn frame_values(f: &Frame, i: usize) -> [f64; 10] {
    let [r, g, b] = f.rgb[i];
    let [x, y, z] = f.normal[i];
    [r, g, b, f.transmittance[i], f.depth[i], f.median_depth[i], x, y, z, f.distortion[i]]
        .map(f64::from)
}

pub(crate) const NAMES: [&str; 10] =
    ["r", "g", "b", "T", "depth", "median", "nx", "ny", "nz", "distortion"];

/// Compares a frame with the oracle; returns the largest error, relative to the value or to 1, and
/// the share of pixels left out.
pub(crate) fn compare(
    soup: &Soup,
    camera: &Camera,
    options: &SoftOptions,
    tolerance: f64,
) -> (f64, f64) {
    let mut soft = SoftRasterizer::new();
    let frame = soft.render(&SoupRef::from(soup), camera, options).clone();
    let picture = oracle::render(&plain(soup), &oracle_camera(camera), &rules(options));
    let mut worst = 0.0f64;
    let mut left_out = 0;
    for (i, pixel) in picture.iter().enumerate() {
        if pixel.margin < MARGIN {
            left_out += 1;
            continue;
        }
        for ((got, want), name) in
            frame_values(&frame, i).into_iter().zip(pixel_values(pixel)).zip(NAMES)
        {
            let error = (got - want).abs() / want.abs().max(1.0);
            assert!(error < tolerance, "{name} of pixel {i}: {got} instead of {want}");
            worst = worst.max(error);
        }
    }
    compare_importance(soup, &soft, &picture);
    (worst, f64::from(left_out) / picture.len() as f64)
}

pub(crate) fn compare_importance(soup: &Soup, soft: &SoftRasterizer, picture: &[Pixel<f64>]) {
    let mut importance = Importance::new(soup.len());
    soft.accumulate_importance(&mut importance);
    for t in 0..soup.len() {
        let weights = || picture.iter().map(|p| p.weights[t]);
        let sum = weights().sum::<f64>();
        let max = weights().fold(0.0, f64::max);
        assert!(
            (f64::from(importance.sum_weight[t]) - sum).abs() < 1e-3 * sum.max(1.0) + 0.02,
            "triangle {t}"
        );
        assert!((f64::from(importance.max_weight[t]) - max).abs() < 5e-3, "triangle {t}");
        let pixels = weights().filter(|w| *w > 0.0).count() as i64;
        assert!(
            (i64::from(importance.pixels[t]) - pixels).abs() <= 1 + pixels / 100,
            "triangle {t}"
        );
    }
}

/// A random gradient of a frame, zero near jumps.
pub(crate) fn random_grad(seed: u64, picture: &[Pixel<f64>], geometry: bool) -> FrameGrad {
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

/// Largest error of a gradient, each group (vertices, opacity, σ, SH) relative to its largest entry
/// in the triangle, or to 2% of its largest in all triangles.
pub(crate) fn compare_grads(
    soup: &Soup,
    camera: &Camera,
    options: &SoftOptions,
    seed: u64,
    tolerance: f64,
) -> f64 {
    let picture = oracle::render(&plain(soup), &oracle_camera(camera), &rules(options));
    let d = random_grad(seed, &picture, options.geometry);
    let mut soft = SoftRasterizer::new();
    let mut grad = SoupGrad::default();
    soft.render(&SoupRef::from(soup), camera, options);
    soft.backward(&SoupRef::from(soup), camera, options, &d, &mut grad);
    assert_eq!(grad.dropped, 0);
    let k = soup.sh_count();
    let all: Vec<_> = (0..soup.len())
        .map(|t| (exact_grad(soup, t, camera, options, &d), soup_grad(&grad, t, k)))
        .collect();
    let mut worst = 0.0f64;
    for (name, range) in
        [("vertices", 0..9), ("opacity", 9..10), ("sigma", 10..11), ("sh", 11..11 + 3 * k)]
    {
        if name == "sigma" && matches!(options.window, Window::Coverage { .. }) {
            assert!(all.iter().all(|(_, got)| got[10] == 0.0));
            continue;
        }
        let size =
            all.iter().flat_map(|(e, _)| &e[range.clone()]).fold(0.0f64, |m, x| m.max(x.abs()));
        assert!(size > 0.0, "nothing to compare");
        for (t, (exact, got)) in all.iter().enumerate() {
            for n in range.clone() {
                let own = exact[range.clone()].iter().fold(0.0f64, |m, x| m.max(x.abs()));
                let error = (exact[n] - got[n]).abs() / own.max(0.02 * size);
                assert!(
                    error < tolerance,
                    "{name} of {t}, entry {n}: {} instead of {}",
                    got[n],
                    exact[n]
                );
                worst = worst.max(error);
            }
        }
    }
    worst
}
