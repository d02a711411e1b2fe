//! Gradients of whole frames against dual numbers through the oracle.

use super::compare::compare_grads;
use super::scenes::{camera, options, random_soup};
use trisplat_raster::soft::{SoftOptions, Sort};

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
