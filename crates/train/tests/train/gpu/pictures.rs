//! Pictures that the card draws are those that the CPU draws.

use super::{card, scene, small_card};
use glam::{UVec2, Vec3};
use trisplat_gpu::Gpu;
use trisplat_raster::soft::{Frame, SoftOptions, SoftRasterizer, Sort, SoupRef, Window};
use trisplat_scene::{Soup, camera::Camera};
use trisplat_train::{
    Anneal, CardScene, GpuBackend, GpuLimits, OptimizerState, Schedule, StepParams, StepPhoto,
    TrainBackend, TrainOptions, TrainPreset,
};

/// A random soup, some of its triangles opaque and with edges as hard as there are.
fn soup(count: usize, sh_degree: u8) -> Soup {
    let mut soup = scene::state(count, sh_degree).params.to_soup(&Anneal::NONE, sh_degree);
    for i in (0..count).step_by(7) {
        soup.opacity[i] = 1.0;
        soup.sigma[i] = 1e-4;
    }
    soup
}

/// 99.9% of the colours and transmittances are so close, and the rest is the few pixels where a
/// layer is drawn on one side of the cutoff here and on the other there.
fn assert_close(card: &Frame, cpu: &Frame, what: &str) {
    assert_eq!(card.size, cpu.size, "{what}");
    let colors = card.rgb.as_flattened().iter().zip(cpu.rgb.as_flattened());
    let numbers = colors.chain(card.transmittance.iter().zip(&cpu.transmittance));
    let mut apart: Vec<f32> = numbers.map(|(a, b)| (a - b).abs()).collect();
    apart.sort_by(f32::total_cmp);
    let most = apart[apart.len() * 999 / 1000];
    let last = apart[apart.len() - 1];
    assert!(most < 2e-5 && last < 0.02, "{what}: {most:.1e} at p99.9, {last:.1e} at most");
    let drawn = cpu.transmittance.iter().filter(|t| **t < 0.5).count();
    assert!(drawn > cpu.transmittance.len() / 4, "{what}: {drawn} pixels are drawn");
}

fn ways() -> Vec<(&'static str, SoftOptions)> {
    let plain = SoftOptions { background: [0.2, 0.5, 0.9], ..SoftOptions::default() };
    let coverage = Window::Coverage { width_px: 1.0 };
    vec![
        ("soft", plain),
        ("soft, per pixel", SoftOptions { sort: Sort::Pixel, ..plain }),
        ("no fade, no cap", SoftOptions { fade_px: 0.0, alpha_cap: 1.0, ..plain }),
        ("coverage, linear", SoftOptions { window: coverage, linear: true, ..plain }),
        ("geometry is not drawn", SoftOptions { geometry: true, ..plain }),
    ]
}

fn gpu(limits: GpuLimits, soup: &Soup) -> CardScene {
    CardScene::with_limits(card().unwrap(), soup, limits).unwrap()
}

#[test]
fn pictures_are_those_of_the_cpu() {
    let Some(first) = card() else { return };
    for sh_degree in [0, 3] {
        let soup = soup(600, sh_degree);
        // No room for anything at first: it is made while they are drawn.
        let limits = GpuLimits {
            pairs_per_triangle: 0,
            min_pairs: 1,
            near_plane_splats: 0,
            ..GpuLimits::of(&first)
        };
        let mut scene_on_card = gpu(limits, &soup);
        for (name, options) in ways() {
            for size in [scene::SIZE, UVec2::new(33, 130)] {
                let camera = scene::camera().resized(size);
                let drawn = scene_on_card.frame(&camera, &options).unwrap();
                let mut soft = SoftRasterizer::new();
                let wants = soft.render(&SoupRef::from(&soup), &camera, &options);
                assert_close(&drawn, wants, &format!("{name}, degree {sh_degree}, {size}"));
                assert_eq!(drawn, scene_on_card.frame(&camera, &options).unwrap(), "{name}, twice");
            }
        }
    }
}

#[test]
fn gpu_draws_scenes_of_several_bindings_and_of_none() {
    let Some(small) = small_card(160 << 10) else { return };
    let large = soup(1100, 3);
    let options = SoftOptions::default();
    let drawn = CardScene::new(small, &large).unwrap().frame(&scene::camera(), &options).unwrap();
    assert_close(
        &drawn,
        SoftRasterizer::new().render(&SoupRef::from(&large), &scene::camera(), &options),
        "parts",
    );
    let nothing = Soup { sh_degree: 0, ..Soup::default() };
    let mut empty = CardScene::new(card().unwrap(), &nothing).unwrap();
    let options = SoftOptions { background: [0.25, 0.5, 0.75], ..options };
    let frame = empty.frame(&scene::camera(), &options).unwrap();
    assert!(frame.rgb.iter().all(|rgb| *rgb == [0.25, 0.5, 0.75]));
    assert!(frame.transmittance.iter().all(|t| *t == 1.0));
}

/// A step as far as a run of `preset` is after a part of its steps.
fn rates(preset: TrainPreset, progress: f64) -> StepParams {
    let options = TrainOptions::preset(preset);
    Schedule::new(&options).rates((progress * options.steps as f64) as u64)
}

fn step(backend: &mut GpuBackend, camera: &Camera, rates: &StepParams) {
    let pixels = scene::photo(false);
    let photo = StepPhoto { camera, pixels: &pixels, first: true, id: None };
    backend.step(&photo, rates).unwrap();
}

#[test]
fn gpu_preview_of_a_training_changes_no_bit() {
    let Some(gpu) = card() else { return };
    let camera = scene::camera();
    let closer = Camera { translation: camera.translation - Vec3::Z, ..camera };
    for (preset, progress) in [(TrainPreset::Outdoor, 0.3), (TrainPreset::Solid, 0.5)] {
        let rates = rates(preset, progress);
        let drawing = rates.drawing(&SoftOptions::default());
        let run = |gpu: Gpu, looks: bool| -> OptimizerState {
            let limits = GpuLimits::of(&gpu);
            let mut backend = GpuBackend::new(gpu, SoftOptions::default(), limits).unwrap();
            backend.load(scene::state(500, 1)).unwrap();
            assert!(backend.draws());
            for _ in 0..3 {
                step(&mut backend, &camera, &rates);
                if looks {
                    // Steps are under way while it is asked for.
                    let frame = backend.picture(&closer, &drawing, &rates).unwrap();
                    let soup = backend.params().unwrap().to_soup(&rates.anneal, rates.sh_degree);
                    let mut soft = SoftRasterizer::new();
                    let wants = soft.render(&SoupRef::from(&soup), &closer, &drawing);
                    assert_close(&frame, wants, &format!("{preset:?}"));
                }
            }
            backend.store().unwrap()
        };
        assert_eq!(run(card().unwrap(), true), run(card().unwrap(), false));
    }
    drop(gpu);
}
