//! Whole frames against the oracle.

use super::compare::{compare, compare_grads};
use super::scenes::{camera, engine, options, random_soup};
use trisplat_raster::soft::{SoftOptions, SoftRasterizer, Sort, SoupRef, Window};

/// Largest error of a frame blended in the order of the tile.
const FRAME_BY_TILE: f64 = 2.5e-5;
/// Largest error of a frame blended in the order of each pixel.
const FRAME_BY_PIXEL: f64 = 1.5e-4;
/// Largest error of a frame of clipped triangles.
const CLIPPED_FRAME: f64 = 5e-5;
/// Largest error of a frame of covered pixels.
const COVERED_FRAME: f64 = 2.5e-5;
/// Largest error of its gradient.
const COVERED_GRADIENT: f64 = 1.5e-4;
/// Largest share of the pixels that lie near a jump and are left out.
const LEFT_OUT: f64 = 0.005;

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
        let tolerance = if sort == Sort::Pixel { FRAME_BY_PIXEL } else { FRAME_BY_TILE };
        let (worst, left_out) =
            compare(&random_soup(seed, 40, (seed % 4) as u8), &camera(size), &o, tolerance);
        eprintln!(
            "seed {seed}: largest error {worst:.1e}, {:.1}% of the pixels near a jump",
            left_out * 100.0
        );
        assert!(left_out < LEFT_OUT);
    }
}

#[test]
fn triangles_across_the_near_plane_are_clipped() {
    let mut soup = random_soup(6, 30, 1);
    for (i, v) in soup.vertices.iter_mut().enumerate() {
        // One or two corners behind the camera.
        v[0].z = -1.0 - i as f32 * 0.1;
        if i % 2 == 0 {
            v[1].z = -0.5;
        }
    }
    let (worst, left_out) = compare(&soup, &camera([37, 29]), &options(), CLIPPED_FRAME);
    eprintln!("largest error {worst:.1e}, {:.1}% near a jump", left_out * 100.0);
    assert!(left_out < LEFT_OUT);
    let frame =
        SoftRasterizer::new().render(&SoupRef::from(&soup), &camera([37, 29]), &options()).clone();
    assert!(frame.transmittance.iter().filter(|t| **t < 0.9).count() > 200);
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
        let (worst, left_out) =
            compare(&soup, &camera([37, 29]), &SoftOptions { geometry: true, ..o }, COVERED_FRAME);
        eprintln!("seed {seed}: largest error {worst:.1e}, {:.1}% near a jump", left_out * 100.0);
        assert!(left_out < LEFT_OUT);
        // Opacity has no meaning where the last layer is opaque: only soft ones are compared. Nor
        // are colours above 1, at which the gradient passes the clamp.
        soup.opacity.iter_mut().for_each(|o| *o = o.min(0.97));
        soup.sh.as_flattened_mut().iter_mut().for_each(|c| *c *= 0.5);
        let worst = compare_grads(
            &soup,
            &camera([33, 21]),
            &SoftOptions { alpha_cap: 0.98, ..o },
            seed,
            COVERED_GRADIENT,
        );
        eprintln!("seed {seed}: largest relative error {worst:.1e}");
    }
}

#[test]
fn coverage_approaches_the_share_of_samples() {
    // Large and small triangles, and slivers, against 16 x 16 point samples per pixel.
    let mut soup = random_soup(44, 60, 0);
    soup.opacity.fill(1.0);
    soup.sigma.fill(1e-4);
    let small = camera([40, 30]);
    let fine = small.resized(small.size * 16);
    let o = SoftOptions { linear: false, importance: false, ..engine(1.0, Sort::Pixel, 1.0) };
    let points = SoftOptions { window: Window::Soft, fade_px: 0.0, ..o };
    let covered = SoftRasterizer::new().render(&SoupRef::from(&soup), &small, &o).clone();
    let sampled = SoftRasterizer::new().render(&SoupRef::from(&soup), &fine, &points).clone();
    let mut square = 0.0;
    for (i, got) in covered.rgb.iter().enumerate() {
        let x = i % 40 * 16;
        let y = i / 40 * 16;
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
