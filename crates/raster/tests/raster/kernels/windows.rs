//! The window, its cutoff, and the coverage of pixels.

use super::cases::{CASES, between, camera, corners, difference, duals, triangle};
use trisplat_raster::kernel::{splat, window};
use trisplat_scene::{Rng, math::real::Real, math::real::V2};

#[test]
fn window_grad_is_exact() {
    for case in 0..CASES {
        let rng = Rng::new(case, "window", 0);
        let x = [
            between(rng, 0, 0.02, 1.0),
            10f64.powf(between(rng, 1, -2.0, 1.0)),
            between(rng, 2, -4.0, 0.0),
        ];
        let [ratio, sigma, log2_opacity] = duals(x);
        let alpha = window::alpha(ratio.log2(), log2_opacity, sigma);
        let (d_sigma, d_ratio) = window::alpha_grad(x[0], x[0].log2(), x[1], 0.0, alpha.v);
        let d_log2_opacity = alpha.v * std::f64::consts::LN_2;
        assert!(difference(&alpha.d, &[d_ratio, d_sigma, d_log2_opacity]) < 1e-12, "case {case}");
    }
}

#[test]
fn window_is_one_at_the_incenter_and_zero_on_the_boundary() {
    for case in 0..CASES {
        let (focal, center) = camera::<f64>();
        let s = splat::splat(&corners(triangle(case)), focal, center);
        let at = |to| window::ratio(&window::ratios(&s.edge, s.shift, to));
        let tolerance = 1e-12 * 1e3f64.max(1.0 / s.inradius);
        assert!((at(splat::incenter(&s)) - 1.0).abs() < tolerance);
        for corner in [V2::zero(), s.sides[0], s.sides[1], (s.sides[0] + s.sides[1]).scale(0.5)] {
            assert!(at(corner).abs() < tolerance * 10.0, "case {case}");
        }
    }
}

#[test]
fn ratio_floor_is_where_the_window_meets_the_cutoff() {
    for sigma in [1e-4, 0.01, 0.5, 1.16, 20.0, 1e3] {
        for opacity in [0.004, 0.1, 0.99, 1.0f64] {
            let floor = window::ratio_floor(opacity.log2(), sigma, (1.0 / 255.0f64).log2());
            assert!(floor.is_finite() && floor > 0.0);
            if floor > 1e-5 {
                let alpha = window::alpha(floor.log2(), opacity.log2(), sigma);
                assert!((alpha * 255.0 - 1.0).abs() < 1e-9, "{sigma} {opacity}");
            }
        }
    }
}

#[test]
fn exactly_one_edge_is_nearest() {
    for r in [
        [1.0, 2.0, 3.0],
        [2.0, 1.0, 3.0],
        [3.0, 2.0, 1.0],
        [1.0, 1.0, 1.0],
        [2.0, 1.0, 1.0],
        [1.0, 2.0, 1.0],
    ] {
        assert_eq!(window::nearest(&r).iter().filter(|m| **m).count(), 1, "{r:?}");
    }
}

#[test]
fn coverage_and_its_gradient_are_exact_for_edges_and_strips() {
    // The pixel [-1/2, 1/2]² and lines x = const: clipping it is arithmetic.
    let far = 9.0;
    for i in -20..=20 {
        let left = f64::from(i) * 0.04;
        let half_plane = window::coverage(&[left, far, far]);
        assert!((half_plane.max(0.0) - (left + 0.5).clamp(0.0, 1.0)).abs() < 1e-15);
        for width in [0.02, 0.3, 0.9, 2.0] {
            let from = -left;
            let to = width - left;
            let exact = (to.min(0.5) - from.max(-0.5)).max(0.0);
            let strip = window::coverage(&[left, width - left, far]).max(0.0);
            assert!((strip - exact).abs() < 1e-12, "{left} {width}: {strip} {exact}");
        }
    }
    for case in 0..CASES {
        let rng = Rng::new(case, "coverage", 0);
        let x: [f64; 3] = std::array::from_fn(|i| between(rng, i as u64, -0.1, 1.0));
        let exact = window::coverage(&duals(x));
        let got = window::coverage_edges(&x).map(|cut| f64::from(u8::from(cut)));
        assert!(difference(&exact.d, &got) < 1e-12 || exact.d == got, "case {case}");
    }
}
