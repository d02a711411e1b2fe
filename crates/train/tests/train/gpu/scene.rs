//! Random scenes and photos for single steps.

use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_scene::{Rng, camera::Camera, image::RgbImage};
use trisplat_train::{OptimizerState, Params};

/// Not a multiple of a tile, and several tiles each way.
pub(super) const SIZE: UVec2 = UVec2::new(70, 45);

pub(super) fn camera() -> Camera {
    Camera {
        rotation: Mat3::from_rotation_y(0.2) * Mat3::from_rotation_x(-0.1),
        translation: Vec3::new(0.1, -0.2, 3.0),
        focal: Vec2::new(60.0, 58.0),
        center: Vec2::new(36.3, 21.1),
        size: SIZE,
    }
}

/// `count` triangles of all sizes about the origin, some through the near plane.
pub(super) fn state(count: usize, sh_degree: u8) -> OptimizerState {
    let k = (usize::from(sh_degree) + 1).pow(2);
    let mut params = Params { sh_degree, ..Params::default() };
    for i in 0..count as u64 {
        let rng = Rng::new(7, "train_gpu", i);
        let point = |at: u64| Vec3::from([0, 1, 2].map(|c| 2.0 * rng.uniform(3 * at + c) - 1.0));
        let reach = 0.05 + 0.5 * rng.uniform(50).powi(3);
        // Every tenth reaches from the scene to behind the camera.
        let long = if i.is_multiple_of(10) { Vec3::new(0.3, 0.2, -4.0) } else { Vec3::ZERO };
        let center = point(0);
        params.vertices.push([
            center + reach * point(1),
            center + reach * point(2),
            center + reach * point(3) + long,
        ]);
        params.opacity.push(4.0 * rng.uniform(51) - 1.0);
        params.sigma.push(1.5 * rng.uniform(52) - 1.0);
        for m in 0..k as u64 {
            let scale = if m == 0 { 1.0 } else { 0.3 };
            params.sh.push([0, 1, 2].map(|c| scale * (2.0 * rng.uniform(60 + 3 * m + c) - 1.0)));
        }
    }
    OptimizerState::new(params)
}

/// `count` faint triangles before one tile, so that light gets through all of them.
pub(super) fn pile(count: usize) -> OptimizerState {
    let camera = camera();
    let middle = (Vec2::new(40.0, 24.0) - camera.center) / camera.focal;
    let mut params = Params::default();
    for i in 0..count as u64 {
        let rng = Rng::new(7, "pile", i);
        let within = |at: u64| Vec3::from([0, 1, 2].map(|c| 2.0 * rng.uniform(3 * at + c) - 1.0));
        let ray = (middle + 0.04 * within(0).truncate()).extend(1.0);
        let center = camera.rotation.transpose() * ((3.0 + within(0).z) * ray - camera.translation);
        params.vertices.push([1, 2, 3].map(|corner| center + 0.2 * within(corner)));
        params.opacity.push(-3.0 + rng.uniform(51));
        params.sigma.push(1.5 * rng.uniform(52) - 1.0);
        params.sh.push([0, 1, 2].map(|c| 2.0 * rng.uniform(60 + c) - 1.0));
    }
    OptimizerState::new(params)
}

/// A picture, smooth and different in every channel, and with a mask if asked for.
pub(super) fn photo(masked: bool) -> RgbImage {
    let at = |i: u32| (i % SIZE.x, i / SIZE.x);
    let color = |i| {
        let (x, y) = at(i);
        [3 * x + y, 2 * y + 40, x * y].map(|c| (c % 256) as u8)
    };
    let weight = |i| if at(i).0 < 20 { 0 } else { (i % 7) as u8 * 36 };
    let all = || 0..SIZE.element_product();
    RgbImage {
        size: SIZE,
        rgb: all().map(color).collect(),
        alpha: masked.then(|| all().map(weight).collect()),
    }
}
