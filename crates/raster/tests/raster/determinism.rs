//! The same bits for any number of threads and whatever was drawn before.

use super::scenes::{camera, draw, engine, options, random_soup};
use trisplat_oracle::exact::soup_grad;
use trisplat_raster::soft::{FrameGrad, SoftOptions, SoftRasterizer, Sort, SoupGrad, SoupRef};

#[test]
fn the_same_bits_for_any_number_of_threads() {
    let soup = random_soup(21, 5000, 2);
    let solid = engine(1.0, Sort::Pixel, 1.0);
    for o in [options(), SoftOptions { sort: Sort::Pixel, ..options() }, solid] {
        let one = draw(&soup, &camera([150, 90]), &o, 1);
        assert!(one.importance.pixels.iter().any(|&n| n > 0));
        for threads in [2, 3, 8] {
            assert!(
                one == draw(&soup, &camera([150, 90]), &o, threads),
                "{o:?}, {threads} threads"
            );
        }
    }
}

#[test]
fn reused_scratch_memory_changes_nothing() {
    let a = random_soup(22, 300, 1);
    let b = random_soup(23, 200, 1);
    let wide = camera([60, 40]);
    let tall = camera([20, 70]);
    let o = options();
    let mut soft = SoftRasterizer::new();
    let mut grad = SoupGrad::default();
    for (soup, camera) in [(&a, &wide), (&b, &tall), (&a, &tall), (&a, &wide)] {
        let reused = soft.render(&SoupRef::from(soup), camera, &o).clone();
        let d =
            FrameGrad { d_rgb: vec![[1.0, 0.5, -0.5]; reused.rgb.len()], ..FrameGrad::default() };
        soft.backward(&SoupRef::from(soup), camera, &o, &d, &mut grad);
        let mut fresh = SoftRasterizer::new();
        let mut fresh_grad = SoupGrad::default();
        assert!(reused == *fresh.render(&SoupRef::from(soup), camera, &o));
        fresh.backward(&SoupRef::from(soup), camera, &o, &d, &mut fresh_grad);
        assert!(grad == fresh_grad);
    }
}

#[test]
fn gradients_of_unseen_triangles_are_zero() {
    let soup = random_soup(24, 400, 1);
    let grad = draw(&soup, &camera([50, 40]), &options(), 1).grad;
    assert!(grad.visible.windows(2).all(|w| w[0] < w[1]) && grad.visible.len() > 50);
    for t in 0..soup.len() {
        let zero = soup_grad(&grad, t, soup.sh_count()).iter().all(|x| *x == 0.0);
        assert!(zero || grad.visible.binary_search(&(t as u32)).is_ok());
    }
}
