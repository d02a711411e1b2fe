//! Cost of the soft rasteriser on a synthetic scene, part by part.

use crate::camera::Camera;
use crate::raster::importance::Importance;
use crate::raster::soft::{FrameGrad, Soft, SoftOptions, SoupGrad, SoupRef};
use crate::rng::Rng;
use crate::soup::Soup;
use glam::{Mat3, UVec2, Vec2, Vec3};

/// What a frame costs, forward and backward.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RasterCost {
    /// Layers blended per pixel, mean.
    pub contributions_per_px: f64,
    /// Pairs of splats and tiles.
    pub pairs: usize,
    /// Smallest wall time of every part over the frames, ms.
    pub parts: Vec<(&'static str, f64)>,
}

impl RasterCost {
    /// Sum of the parts, ms.
    pub fn total_ms(&self) -> f64 {
        self.parts.iter().map(|(_, ms)| ms).sum()
    }
}

/// `count` triangles with SH of degree 3 that fill the view of [`camera`]; at 50,000 and size 0.027 about 16
/// layers lie on every pixel.
pub fn soup(count: usize, size: f32) -> Soup {
    let mut soup = Soup { sh_degree: 3, ..Soup::default() };
    for i in 0..count {
        let rng = Rng::new(7, "bench", i as u64);
        let u = |k| rng.uniform(k) * 2.0 - 1.0;
        let z = 2.0 + 3.0 * rng.uniform(9);
        let center = Vec3::new(u(0) * 0.55 * z, u(1) * 0.31 * z, z);
        let radius = size * z * (0.5 + rng.uniform(10));
        let corner = |k: u64| center + radius * Vec3::new(u(11 + 3 * k), u(12 + 3 * k), 0.3 * u(13 + 3 * k));
        soup.vertices.push([corner(0), corner(1), corner(2)]);
        soup.opacity.push(0.05 + 0.5 * rng.uniform(20) * rng.uniform(21));
        soup.sigma.push(0.3 + rng.uniform(22));
        soup.sh.extend((0..16).map(|k| [0.1 * u(30 + 3 * k), 0.1 * u(31 + 3 * k), 0.1 * u(32 + 3 * k)]));
    }
    soup
}

/// A camera at the origin, focal length 0.9 times the width.
pub fn camera(size: UVec2) -> Camera {
    let width = size.x as f32;
    Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::ZERO,
        focal: Vec2::splat(0.9 * width),
        center: size.as_vec2() / 2.0,
        size,
    }
}

/// Draws `frames` frames, forward and backward.
pub fn raster(soup: &Soup, camera: &Camera, options: &SoftOptions, frames: usize) -> RasterCost {
    let scene = SoupRef::from(soup);
    let (mut soft, mut grad) = (Soft::new(), SoupGrad::default());
    let pixels = (camera.size.x * camera.size.y) as usize;
    let d = FrameGrad { d_rgb: vec![[0.1, -0.2, 0.3]; pixels], ..FrameGrad::default() };
    let mut importance = Importance::new(soup.len());
    soft.render(&scene, camera, &SoftOptions { importance: true, ..*options });
    soft.accumulate_importance(&mut importance);
    let drawn: f64 = importance.pixels.iter().map(|p| f64::from(*p)).sum();
    let mut cost = RasterCost {
        contributions_per_px: drawn / pixels as f64,
        pairs: soft.load().1,
        ..RasterCost::default()
    };
    for _ in 0..frames {
        soft.render(&scene, camera, options);
        soft.backward(&scene, camera, options, &d, &mut grad);
        if cost.parts.is_empty() {
            cost.parts = soft.timings().to_vec();
        }
        for (least, now) in cost.parts.iter_mut().zip(soft.timings()) {
            least.1 = least.1.min(now.1);
        }
    }
    cost
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_is_what_its_doc_says() {
        let cost = raster(&soup(50_000, 0.027), &camera(UVec2::new(480, 270)), &SoftOptions::default(), 1);
        assert!((15.0..18.0).contains(&cost.contributions_per_px), "{cost:?}");
        assert_eq!(cost.parts.len(), 7);
        assert!(cost.total_ms() > 0.0);
    }
}
