//! A synthetic scene for the soft rasteriser.

use super::timing::{CaseCost, RasterCase, camera, time};
use glam::Vec3;
use trisplat_raster::soft::{FrameGrad, SoftOptions, SoftRasterizer, SoupGrad, SoupRef};
use trisplat_scene::{Rng, Soup};

/// Size of the triangles, relative to their distance.
const SIZE: f32 = 0.027;

/// `count` triangles with SH of degree 3 that fill the view of [`camera`]; with 50,000 of them every
/// pixel has about 16 layers.
fn soup(count: usize) -> Soup {
    let mut soup = Soup { sh_degree: 3, ..Soup::default() };
    for i in 0..count {
        let rng = Rng::new(7, "bench", i as u64);
        let u = |k| rng.uniform(k) * 2.0 - 1.0;
        let z = 2.0 + 3.0 * rng.uniform(9);
        let center = Vec3::new(u(0) * 0.55 * z, u(1) * 0.31 * z, z);
        let radius = SIZE * z * (0.5 + rng.uniform(10));
        let corner = |k: u64| center + radius * Vec3::new(u(11 + 3 * k), u(12 + 3 * k), 0.3 * u(13 + 3 * k));
        soup.vertices.push([corner(0), corner(1), corner(2)]);
        soup.opacity.push(0.05 + 0.5 * rng.uniform(20) * rng.uniform(21));
        soup.sigma.push(0.3 + rng.uniform(22));
        soup.sh.extend((0..16).map(|k| [0.1 * u(30 + 3 * k), 0.1 * u(31 + 3 * k), 0.1 * u(32 + 3 * k)]));
    }
    soup
}

/// What a step costs: a frame forward and backward.
pub(super) fn cost(case: &RasterCase, frames: usize) -> CaseCost {
    let (soup, camera) = (soup(case.triangles), camera(case.size));
    let (mut soft, mut grad) = (SoftRasterizer::new(), SoupGrad::default());
    let (scene, options) = (SoupRef::from(&soup), SoftOptions::default());
    let pixels = (case.size.x * case.size.y) as usize;
    let d = FrameGrad { d_rgb: vec![[0.1, -0.2, 0.3]; pixels], ..FrameGrad::default() };
    time(frames, || {
        soft.render(&scene, &camera, &options);
        soft.backward(&scene, &camera, &options, &d, &mut grad);
        soft.timings().to_vec()
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::UVec2;
    use trisplat_raster::soft::Importance;

    #[test]
    fn the_scene_is_what_its_doc_says() {
        let (soup, camera) = (soup(50_000), camera(UVec2::new(480, 270)));
        let (mut soft, mut importance) = (SoftRasterizer::new(), Importance::new(soup.len()));
        let options = SoftOptions { importance: true, ..SoftOptions::default() };
        soft.render(&SoupRef::from(&soup), &camera, &options);
        soft.accumulate_importance(&mut importance);
        let drawn: f64 = importance.pixels.iter().map(|p| f64::from(*p)).sum();
        let layers = drawn / (480.0 * 270.0);
        assert!((15.0..18.0).contains(&layers), "{layers}");
    }
}
