//! Gradients of whole frames against dual numbers through the oracle.

use super::compare::{compare_grads, grad_values, oracle_camera, pixel_values, plain, random_grad, rules};
use super::scenes::{camera, options, random_soup};
use crate::common::oracle::{self, OracleCamera};
use trisplat::raster::soft::{Soft, SoftOptions, Sort, SoupGrad, SoupRef};

/// Largest error of a gradient.
const GRADIENT: f64 = 1.3e-4;
/// Largest error of a gradient of clipped and tiny triangles.
const CLIPPED_GRADIENT: f64 = 5e-5;

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
        let worst = compare_grads(&soup, &camera([33, 21]), &o, seed, GRADIENT);
        eprintln!("seed {seed}: largest relative error {worst:.1e}");
    }
}

#[test]
fn gradients_of_clipped_and_tiny_triangles_are_exact() {
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
    let worst = compare_grads(&soup, &camera([33, 21]), &o, 15, CLIPPED_GRADIENT);
    eprintln!("largest relative error {worst:.1e}");
}

/// `camera` with its points moved: q + h e × q for the first three axes, q + h e for the other three.
fn moved(camera: &OracleCamera, axis: usize, h: f64) -> OracleCamera {
    let mut out = *camera;
    if axis >= 3 {
        out.translation[axis - 3] += h;
        return out;
    }
    let (a, b) = ((axis + 1) % 3, (axis + 2) % 3);
    let (sin, cos) = h.sin_cos();
    for column in 0..3 {
        let [x, y] = [camera.rotation[a][column], camera.rotation[b][column]];
        out.rotation[a][column] = cos * x - sin * y;
        out.rotation[b][column] = sin * x + cos * y;
    }
    let [x, y] = [camera.translation[a], camera.translation[b]];
    (out.translation[a], out.translation[b]) = (cos * x - sin * y, sin * x + cos * y);
    out
}

#[test]
fn the_gradient_of_a_camera_equals_differences_through_the_oracle() {
    // View-dependent colour follows a motion of the camera, but not its turn: see `SoupGrad::camera`.
    for (seed, degree, sort, geometry, axes) in
        [(21, 0, Sort::Tile, false, 0..6), (22, 0, Sort::Pixel, true, 0..6), (23, 2, Sort::Tile, false, 3..6)]
    {
        let o = SoftOptions { sort, geometry, ..options() };
        let (soup, camera) = (random_soup(seed, 14, degree), camera([33, 21]));
        let (exact, triangles) = (oracle_camera(&camera), plain(&soup));
        let d = random_grad(seed, &oracle::render(&triangles, &exact, &rules(&o)), geometry);
        let loss = |camera: &OracleCamera| -> f64 {
            let picture = oracle::render(&triangles, camera, &rules(&o));
            let products = |(i, pixel)| -> f64 {
                pixel_values(pixel).into_iter().zip(grad_values(&d, i)).map(|(x, weight)| x * weight).sum()
            };
            picture.iter().enumerate().map(products).sum()
        };
        let (mut soft, mut grad) = (Soft::new(), SoupGrad::default());
        soft.render(&SoupRef::from(&soup), &camera, &o);
        soft.backward(&SoupRef::from(&soup), &camera, &o, &d, &mut grad);
        let found = grad.camera(&soup.vertices, &camera);
        let found = [found.rotation.to_array(), found.translation.to_array()].concat();
        let h = 1e-6;
        let want = |axis| (loss(&moved(&exact, axis, h)) - loss(&moved(&exact, axis, -h))) / (2.0 * h);
        let wanted: Vec<f64> = (0..6).map(want).collect();
        // A sum over corners is as exact as their gradients are.
        let size = wanted.iter().fold(0.0f64, |most, x| most.max(x.abs()));
        for axis in axes {
            let error = (found[axis] - wanted[axis]).abs() / size;
            assert!(error < GRADIENT, "seed {seed}, axis {axis}: {found:?} instead of {wanted:?}");
        }
    }
}
