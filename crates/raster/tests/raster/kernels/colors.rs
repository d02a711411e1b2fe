//! Blending, distortion and spherical harmonics.

use super::cases::{CASES, between, difference, duals};
use trisplat_oracle::dual::Dual;
use trisplat_raster::kernel::{sh, window};
use trisplat_scene::{Rng, math::real::Real, math::real::V3};

/// Layers of (alpha, value) over a background value, as duals.
fn blended<R: Real>(alphas: &[R], values: &[R], background: R) -> R {
    let mut sum = R::of(0.0);
    let mut t = R::of(1.0);
    for (alpha, value) in alphas.iter().zip(values) {
        let (w, after) = window::blend(t, *alpha);
        sum = sum + w * *value;
        t = after;
    }
    sum + t * background
}

#[test]
fn blend_grad_is_exact_up_to_alpha_one() {
    for (case, ends) in [(0, 0.7), (1, 1.0), (2, 0.9999)] {
        let rng = Rng::new(case, "blend", 0);
        let mut alphas: [f64; 6] = std::array::from_fn(|i| between(rng, i as u64, 0.05, 0.6));
        alphas[5] = ends;
        let values: [f64; 6] = std::array::from_fn(|i| between(rng, 10 + i as u64, -1.0, 1.0));
        let background = 0.3;
        let loss = blended(&duals(alphas), &values.map(Dual::of), Dual::of(background));
        let mut behind = loss.v;
        let mut t = 1.0;
        let mut got = Vec::new();
        for i in 0..6 {
            let (w, after) = window::blend(t, alphas[i]);
            behind -= w * values[i];
            got.push(window::blend_grad(t, alphas[i], values[i], behind, i == 5, background));
            t = after;
        }
        assert!(difference(&loss.d, &got) < 1e-12, "case {case}");
    }
}

#[test]
fn distortion_grad_is_exact() {
    let w = [0.3, 0.2, 0.15, 0.1];
    let m = [0.1, 0.25, 0.3, 0.7];
    let x: [f64; 8] = std::array::from_fn(|i| if i < 4 { w[i] } else { m[i - 4] });
    let dual = duals(x);
    let mut loss = Dual::of(0.0);
    let mut sums = [Dual::of(0.0); 3];
    let mut brute = Dual::<8>::of(0.0);
    for i in 0..4 {
        let w = dual[i];
        let m = dual[i + 4];
        loss = loss + window::distortion(w, m, sums);
        sums = [sums[0] + w, sums[1] + w * m, sums[2] + w * m * m];
        for j in 0..i {
            let d = m - dual[j + 4];
            brute = brute + w * dual[j] * d * d;
        }
    }
    assert!((loss.v - brute.v).abs() < 1e-15 && difference(&brute.d, &loss.d) < 1e-12);
    let totals = sums.map(|s| s.v);
    let grads: Vec<_> = (0..4).map(|i| window::distortion_grad(w[i], m[i], totals)).collect();
    let got: Vec<f64> = grads.iter().map(|g| g.0).chain(grads.iter().map(|g| g.1)).collect();
    assert!(difference(&brute.d, &got) < 1e-12);
}

#[test]
fn sh_grad_is_exact() {
    for case in 0..CASES {
        let rng = Rng::new(case, "sh", 0);
        let degree = (case % 4) as u8;
        let x: [f64; 3] = std::array::from_fn(|i| between(rng, i as u64, -2.0, 2.0));
        let weights: [f64; sh::MAX_COEFFICIENTS] =
            std::array::from_fn(|i| between(rng, 10 + i as u64, -1.0, 1.0));
        let [a, b, c] = duals(x);
        let v = V3::new(a, b, c);
        let unit = v.scale(Dual::of(1.0) / v.length());
        let mut loss = Dual::of(0.0);
        for (y, w) in sh::basis(degree, unit).into_iter().zip(weights) {
            loss = loss + y * Dual::of(w);
        }
        let length = v.length().v;
        let unit = V3::new(unit.x.v, unit.y.v, unit.z.v);
        let got = sh::normalize_grad(unit, length, sh::basis_grad(degree, unit, &weights));
        if degree > 0 {
            assert!(difference(&loss.d, &[got.x, got.y, got.z]) < 1e-12, "case {case}");
        }
    }
}

#[test]
fn sh_basis_is_orthonormal() {
    // Fibonacci sphere: an equal-weight quadrature.
    let n = 20_000;
    let mut gram = [[0.0f64; sh::MAX_COEFFICIENTS]; sh::MAX_COEFFICIENTS];
    for i in 0..n {
        let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
        let (s, c) = (2.399_963_229_728_653 * f64::from(i)).sin_cos();
        let r = (1.0 - z * z).sqrt();
        let y = sh::basis(3, V3::new(r * c, r * s, z));
        for a in 0..sh::MAX_COEFFICIENTS {
            for b in 0..sh::MAX_COEFFICIENTS {
                gram[a][b] += y[a] * y[b] * 4.0 * std::f64::consts::PI / f64::from(n);
            }
        }
    }
    for (a, row) in gram.iter().enumerate() {
        for (b, x) in row.iter().enumerate() {
            assert!((x - f64::from(u8::from(a == b))).abs() < 1e-3, "{a} {b} {x}");
        }
    }
}
