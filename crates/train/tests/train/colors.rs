//! Colours that left their range return to it.

use glam::{Mat3, UVec2, Vec2, Vec3};
use trisplat_scene::{camera::Camera, image::RgbImage, rgb_from_sh0, sh0_from_rgb};
use trisplat_train::{
    CpuBackend, OptimizerState, Params, Schedule, StepPhoto, TrainBackend, TrainOptions,
    TrainPreset,
};

const SIZE: UVec2 = UVec2::new(24, 16);

/// One triangle that fills the picture and changes its colour alone.
fn wall(rgb: [f32; 3]) -> OptimizerState {
    let params = Params {
        vertices: vec![[
            Vec3::new(-9.0, -5.0, 0.0),
            Vec3::new(9.0, -5.0, 0.0),
            Vec3::new(0.0, 12.0, 0.0),
        ]],
        opacity: vec![6.0],
        sigma: vec![-6.0],
        sh: vec![rgb.map(sh0_from_rgb)],
        sh_degree: 0,
    };
    OptimizerState { pinned: 1, ..OptimizerState::new(params) }
}

/// The wall's colour after training on a grey photo, encoded or in linear light.
fn trained_on_grey(start: [f32; 3], linear: bool) -> [f32; 3] {
    let options = TrainOptions::preset(TrainPreset::Outdoor);
    let schedule = Schedule::new(&options);
    let mut backend = CpuBackend::new(options.drawing([0.5; 3]));
    backend.load(wall(start)).unwrap();
    let camera = Camera {
        rotation: Mat3::IDENTITY,
        translation: Vec3::new(0.0, 0.0, 3.0),
        focal: Vec2::splat(20.0),
        center: SIZE.as_vec2() / 2.0,
        size: SIZE,
    };
    let pixels =
        RgbImage { size: SIZE, rgb: vec![[128; 3]; SIZE.element_product() as usize], alpha: None };
    for step in 0..1500 {
        let mut rates = schedule.rates(step);
        if linear {
            rates.engine_shading = true;
            rates.alpha_cap = 1.0;
        }
        let photo = StepPhoto { camera: &camera, pixels: &pixels, first: true, id: None };
        backend.step(&photo, &rates).unwrap();
    }
    backend.store().unwrap().params.sh[0].map(rgb_from_sh0)
}

#[test]
fn a_channel_below_zero_under_a_grey_photo_comes_back() {
    for linear in [false, true] {
        let rgb = trained_on_grey([0.5, 0.5, -0.1], linear);
        assert!(rgb.iter().all(|c| (c - 0.5).abs() < 0.1), "linear: {linear}: {rgb:?}");
    }
}

#[test]
fn a_channel_above_one_under_a_grey_photo_comes_back() {
    for linear in [false, true] {
        let rgb = trained_on_grey([0.5, 0.5, 1.1], linear);
        assert!(rgb.iter().all(|c| (c - 0.5).abs() < 0.1), "linear: {linear}: {rgb:?}");
    }
}
