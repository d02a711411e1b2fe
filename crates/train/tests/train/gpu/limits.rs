//! The bits of a run do not depend on what the backend takes of the card: how far it is behind, how
//! much room there is, whether photos stay.

use super::{card, scene, small_card};
use glam::{Mat3, Vec3};
use trisplat_raster::soft::SoftOptions;
use trisplat_scene::{camera::Camera, image::RgbImage};
use trisplat_train::{
    BackendVisibility, GpuBackend, GpuLimits, OptimizerState, PhotoId, Schedule, StepParams,
    StepPhoto, StepStats, TrainBackend, TrainOptions, TrainPreset,
};

const STEPS: usize = 9;
const PHOTOS: usize = 3;

/// Cameras that come closer: every round of them needs more room than the one before.
fn cameras() -> Vec<Camera> {
    let camera = |step: usize| Camera {
        rotation: Mat3::from_rotation_y(0.4 * (step % PHOTOS) as f32),
        translation: Vec3::new(0.0, 0.0, 8.0 - 0.8 * step as f32),
        ..scene::camera()
    };
    (0..STEPS).map(camera).collect()
}

fn photos() -> Vec<RgbImage> {
    let photo = |shift: usize| {
        let mut photo = scene::photo(shift == 1);
        photo.rgb.rotate_left(17 * shift);
        photo
    };
    (0..PHOTOS).map(photo).collect()
}

/// Two chunks and a bit of the scene, and less than all slots: more has no use for the tests.
const BINDING_BYTES: u64 = 160 << 10;

/// Options that a user may train with.
struct Way {
    name: &'static str,
    options: SoftOptions,
    rates: StepParams,
}

fn ways() -> [Way; 3] {
    let way = |name, change: fn(&mut TrainOptions), rates: fn(&mut StepParams)| {
        let mut options = TrainOptions::preset(TrainPreset::Outdoor);
        change(&mut options);
        let mut found = Schedule::new(&options).rates(1000);
        rates(&mut found);
        Way { name, options: options.drawing([0.3, 0.5, 0.7]), rates: found }
    };
    [
        way("soft", |_| {}, |_| {}),
        way("per pixel", |o| o.draw.sort_per_pixel = true, |_| {}),
        way("regularised", |_| {}, |r| (r.beta_size, r.beta_normal) = (1e-3, 0.1)),
    ]
}

#[derive(PartialEq, Debug)]
struct Outcome {
    state: OptimizerState,
    figures: Vec<StepStats>,
    weights: Vec<f32>,
    errors: Vec<u64>,
    views: Vec<u32>,
}

/// All steps; some figures are asked for on the way.
fn run(backend: &mut GpuBackend, way: &Way, limits: GpuLimits) -> Outcome {
    backend.restart(way.options, limits);
    let mut state = scene::state(1100, 3);
    state.pinned = 10;
    state.frozen = 5;
    backend.load(state).unwrap();
    let photos = photos();
    let mut figures = Vec::new();
    for (step, camera) in cameras().iter().enumerate() {
        let index = step % PHOTOS;
        let id = Some(PhotoId { index, level: 0, corrected: false });
        let photo = StepPhoto { camera, pixels: &photos[index], first: step < PHOTOS, id };
        backend.step(&photo, &way.rates).unwrap();
        figures.extend(backend.figures(false).unwrap());
    }
    figures.extend(backend.figures(true).unwrap());
    let BackendVisibility { first, error, .. } = backend.take_visibility().unwrap();
    let state = backend.store().unwrap();
    Outcome { state, figures, weights: first.max_weight, errors: error, views: first.views }
}

#[test]
fn limits_change_no_bit() {
    let Some(gpu) = card() else { return };
    let plenty = GpuLimits {
        ahead: 0,
        photo_bytes: 0,
        pairs_per_triangle: 64,
        near_plane_splats: 1000,
        ..GpuLimits::of(&gpu)
    };
    let small = GpuLimits { pairs_per_triangle: 0, min_pairs: 64, near_plane_splats: 0, ..plenty };
    let photo_bytes = 4 * u64::from(scene::SIZE.element_product());
    let mut backend = GpuBackend::new(gpu, SoftOptions::default(), plenty).unwrap();
    for way in ways() {
        // Only the layers of pixels have no room at first.
        let before = backend.repeats();
        let waiting = run(&mut backend, &way, plenty);
        assert_eq!(backend.repeats() > before, way.name == "per pixel", "{}", way.name);
        assert_eq!(waiting.figures.len(), STEPS);
        for (name, limits) in [
            ("late", GpuLimits { ahead: 3, ..plenty }),
            ("little room", small),
            ("little room, late", GpuLimits { ahead: 3, ..small }),
            ("little room, all at once", GpuLimits { ahead: STEPS, ..small }),
            ("photos on the card", GpuLimits { ahead: 2, photo_bytes: 3 * photo_bytes, ..plenty }),
            (
                "two photos on the card",
                GpuLimits { ahead: 2, photo_bytes: 2 * photo_bytes, ..small },
            ),
            ("split", GpuLimits { ahead: 2, binding_bytes: BINDING_BYTES, ..plenty }),
            ("split small", GpuLimits { ahead: 2, binding_bytes: 1, ..plenty }),
        ] {
            if way.name != "soft" && !name.contains("all at once") && !name.contains("split small")
            {
                continue;
            }
            let before = backend.repeats();
            let outcome = run(&mut backend, &way, limits);
            let repeats = backend.repeats() - before;
            eprintln!("{}, {name}: repeated {repeats} times", way.name);
            assert!(repeats > 1 || limits.min_pairs > 64, "{}, {name}: {repeats}", way.name);
            assert_eq!(outcome.figures, waiting.figures, "{}, {name}", way.name);
            assert!(outcome == waiting, "{}, {name}: other bits", way.name);
        }
    }
}

/// Every buffer is within what such a card binds, or wgpu would refuse it.
#[test]
fn a_card_that_binds_little_gives_the_same_bits() {
    let (Some(gpu), Some(small)) = (card(), small_card(BINDING_BYTES)) else { return };
    let limits = GpuLimits::of(&small);
    assert_eq!(limits.binding_bytes, BINDING_BYTES);
    let all = GpuLimits::of(&gpu);
    let mut whole = GpuBackend::new(gpu, SoftOptions::default(), all).unwrap();
    let mut split = GpuBackend::new(small, SoftOptions::default(), limits).unwrap();
    for way in ways().into_iter().filter(|way| way.name != "per pixel") {
        let whole = run(&mut whole, &way, GpuLimits { binding_bytes: u64::MAX, ..limits });
        assert!(run(&mut split, &way, limits) == whole, "{}", way.name);
    }
}
