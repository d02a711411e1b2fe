//! Random cases, and how gradients are compared.

use trisplat_oracle::dual::Dual;
use trisplat_raster::kernel::splat::CameraTriangle;
use trisplat_scene::{
    Rng,
    math::real::Real,
    math::real::{V2, V3},
};

/// Largest difference of two gradients relative to their size.
pub(crate) fn difference(exact: &[f64], got: &[f64]) -> f64 {
    assert_eq!(exact.len(), got.len());
    let size = exact.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    exact.iter().zip(got).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size.max(1e-300)
}

pub(crate) fn between(rng: Rng, index: u64, lo: f64, hi: f64) -> f64 {
    lo + (hi - lo) * rng.uniform_f64(index)
}

pub(crate) const CASES: u64 = 200;
pub(crate) const FOCAL: [f64; 2] = [310.0, 290.0];
pub(crate) const CENTER: [f64; 2] = [100.0, 70.0];

/// v0, e1, e2 of a triangle in front of the camera.
pub(crate) fn triangle(case: u64) -> [f64; 9] {
    let rng = Rng::new(case, "triangle", 0);
    let size = 10f64.powf(between(rng, 20, -2.0, 0.3));
    let mut out = [0.0; 9];
    for (i, x) in out.iter_mut().enumerate() {
        *x = between(rng, i as u64, -1.0, 1.0) * if i < 3 { 1.0 } else { size };
    }
    out[2] = between(rng, 2, 4.0, 8.0);
    out
}

pub(crate) fn corners<R: Real>(x: [R; 9]) -> CameraTriangle<R> {
    let v = |i: usize| V3::new(x[i], x[i + 1], x[i + 2]);
    CameraTriangle { first: v(0), edges: [v(3), v(6)] }
}

pub(crate) fn flat(c: &CameraTriangle<f64>) -> Vec<f64> {
    [c.first, c.edges[0], c.edges[1]].iter().flat_map(|v| [v.x, v.y, v.z]).collect()
}

pub(crate) fn camera<R: Real>() -> (V2<R>, V2<R>) {
    (V2::new(R::of(FOCAL[0]), R::of(FOCAL[1])), V2::new(R::of(CENTER[0]), R::of(CENTER[1])))
}

pub(crate) fn duals<const N: usize>(x: [f64; N]) -> [Dual<N>; N] {
    std::array::from_fn(|i| Dual::variable(x[i], i))
}
