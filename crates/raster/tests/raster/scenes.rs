//! Random soups, a camera, and the options and gradients that the tests draw with.

use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_raster::soft::{
    Frame, FrameGrad, Importance, SoftOptions, SoftRasterizer, Sort, SoupGrad, SoupRef, Window,
};
use trisplat_scene::{Rng, Soup, camera::Camera};

pub(crate) fn random_soup(seed: u64, count: usize, degree: u8) -> Soup {
    let k = (degree as usize + 1).pow(2);
    let mut soup = Soup { sh_degree: degree, ..Soup::default() };
    for i in 0..count {
        let rng = Rng::new(seed, "soup", i as u64);
        let at = |n: u64, lo: f32, hi: f32| lo + (hi - lo) * rng.uniform(n);
        let center = Vec3::new(at(0, -1.2, 1.2), at(1, -1.0, 1.0), at(2, 2.5, 6.0));
        let size = 10f32.powf(at(3, -0.9, 0.3));
        let corner = |n: u64| {
            center + size * Vec3::new(at(n, -1.0, 1.0), at(n + 1, -1.0, 1.0), at(n + 2, -0.6, 0.6))
        };
        soup.vertices.push([corner(4), corner(7), corner(10)]);
        soup.opacity.push(at(13, 0.1, 1.0));
        soup.sigma.push(10f32.powf(at(14, -1.5, 0.8)));
        for n in 0..k as u64 {
            let scale = if n == 0 { 1.2 } else { 0.3 };
            soup.sh.push([0, 1, 2].map(|c| at(20 + 3 * n + c, -scale, scale)));
        }
    }
    soup
}

pub(crate) fn camera(size: [u32; 2]) -> Camera {
    let rotation = Mat3::from_rotation_y(0.2) * Mat3::from_rotation_x(-0.1);
    let focal = 0.9 * size[0] as f32;
    Camera {
        rotation,
        translation: Vec3::new(0.3, -0.1, 0.4),
        focal: Vec2::new(focal, focal * 1.1),
        center: Vec2::new(0.47, 0.52) * Vec2::new(size[0] as f32, size[1] as f32),
        size: UVec2::from_array(size),
    }
}

pub(crate) fn options() -> SoftOptions {
    SoftOptions {
        background: [0.2, 0.5, 0.9],
        geometry: true,
        importance: true,
        min_ratio: 0.0,
        near: 0.4,
        ..SoftOptions::default()
    }
}

/// Opaque triangles as an engine covers pixels, in its order and light.
pub(crate) fn engine(width_px: f32, sort: Sort, cap: f32) -> SoftOptions {
    SoftOptions {
        window: Window::Coverage { width_px },
        sort,
        alpha_cap: cap,
        linear: true,
        geometry: false,
        ..options()
    }
}

/// A frame, its gradient for some gradient of the frame, and its importance.
#[derive(Debug, PartialEq)]
pub(crate) struct Outputs {
    pub(crate) frame: Frame,
    pub(crate) grad: SoupGrad,
    pub(crate) importance: Importance,
}

/// Draws a frame forward and backward with `threads` threads.
pub(crate) fn draw(soup: &Soup, camera: &Camera, options: &SoftOptions, threads: usize) -> Outputs {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("a thread pool");
    pool.install(|| {
        let mut soft = SoftRasterizer::new();
        let frame = soft.render(&SoupRef::from(soup), camera, options).clone();
        let count = frame.rgb.len();
        let d = FrameGrad {
            d_rgb: (0..count).map(|i| [0.5, -0.25, (i % 7) as f32 * 0.1]).collect(),
            d_distortion: vec![0.3; if options.geometry { count } else { 0 }],
            ..FrameGrad::default()
        };
        let mut grad = SoupGrad::default();
        soft.backward(&SoupRef::from(soup), camera, options, &d, &mut grad);
        let mut importance = Importance::new(soup.len());
        soft.accumulate_importance(&mut importance);
        Outputs { frame, grad, importance }
    })
}
