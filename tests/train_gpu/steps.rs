//! Single steps: their gradients, as Adam's first moments show them, their figures, and what was visible.

use super::{card, scene};
use trisplat::raster::soft::SoftOptions;
use trisplat::train::backend::{BackendVisibility, StepPhoto, StepStats, TrainBackend};
use trisplat::train::cpu::CpuBackend;
use trisplat::train::gpu::GpuBackend;
use trisplat::train::params::{Params, TrainState};
use trisplat::train::schedule::{EngineShading, Rates, Schedule};
use trisplat::train::{TrainOptions, TrainPreset};

/// One way to train.
struct Case {
    name: &'static str,
    preset: TrainPreset,
    change: fn(&mut TrainOptions),
    rates: fn(&mut Rates),
    sh_degree: u8,
    pinned: usize,
    masked: bool,
}

const PLAIN: Case = Case {
    name: "soft",
    preset: TrainPreset::Outdoor,
    change: |_| {},
    rates: |_| {},
    sh_degree: 3,
    pinned: 0,
    masked: false,
};

fn engine(samples: u32, linear: bool) -> Option<EngineShading> {
    Some(EngineShading { samples, edge_width_samples: 1.0, linear })
}

const CASES: &[Case] = &[
    PLAIN,
    Case { name: "one colour, pinned", sh_degree: 0, pinned: 30, ..PLAIN },
    Case { name: "degree 1", sh_degree: 1, ..PLAIN },
    Case { name: "masked", masked: true, sh_degree: 0, ..PLAIN },
    Case { name: "not sparse", rates: |r| r.sparse = false, sh_degree: 2, ..PLAIN },
    Case { name: "per pixel", change: |o| o.draw.sort_per_pixel = true, sh_degree: 1, ..PLAIN },
    Case { name: "held incenter", change: |o| o.draw.exact_incenter = false, sh_degree: 0, ..PLAIN },
    Case {
        name: "sigmoid",
        change: |o| o.draw.sigmoid_window = true,
        sh_degree: 0,
        ..PLAIN
    },
    Case { name: "engine", rates: |r| (r.engine_shading, r.alpha_cap) = (engine(1, true), 0.995), sh_degree: 0, ..PLAIN },
    Case { name: "engine, samples", rates: |r| r.engine_shading = engine(2, false), sh_degree: 0, masked: true, ..PLAIN },
    Case { name: "depth and normals", rates: |r| (r.beta_distortion, r.beta_normal) = (1.0, 0.1), sh_degree: 0, ..PLAIN },
    Case {
        name: "depth and normals per pixel",
        change: |o| o.draw.sort_per_pixel = true,
        rates: |r| (r.beta_distortion, r.beta_normal) = (1.0, 0.1),
        sh_degree: 0,
        ..PLAIN
    },
    Case { name: "regularised", rates: |r| (r.beta_size, r.beta_opaque, r.beta_sigma) = (1e-3, 1.0, 0.1), sh_degree: 0, ..PLAIN },
];

type Outcome = (TrainState, StepStats, BackendVisibility);

fn step(backend: &mut dyn TrainBackend, case: &Case, rates: &Rates) -> Outcome {
    let mut state = scene::state(300, case.sh_degree);
    state.pinned = case.pinned;
    backend.load(state).unwrap();
    let (camera, rgb, mask) = (scene::camera(), scene::photo(), scene::mask());
    let photo =
        StepPhoto { camera: &camera, rgb: &rgb, weight: case.masked.then_some(&mask), first: true };
    let stats = backend.step(&photo, rates).unwrap();
    let visibility = backend.take_visibility().unwrap();
    (backend.store().unwrap(), stats, visibility)
}

fn drawing(case: &Case) -> (SoftOptions, Rates) {
    let mut options = TrainOptions::preset(case.preset);
    (case.change)(&mut options);
    let mut rates = Schedule::new(&options).rates(1000);
    rates.sh_degree = case.sh_degree;
    (case.rates)(&mut rates);
    (options.drawing([0.3, 0.5, 0.7]), rates)
}


/// The groups of numbers.
fn groups(params: &Params) -> [(&'static str, Vec<f32>); 4] {
    let vertices = params.vertices.iter().flatten().flat_map(|v| v.to_array()).collect();
    let sh = params.sh.as_flattened().to_vec();
    [("vertices", vertices), ("opacity", params.opacity.clone()), ("sigma", params.sigma.clone()), ("sh", sh)]
}

/// Largest difference over the largest number.
fn apart(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    let largest = a.iter().fold(1e-30f32, |most, x| most.max(x.abs()));
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / largest).fold(0.0, f32::max)
}

#[test]
fn a_step_is_the_cpus() {
    let Some(gpu) = card() else { return };
    let mut backend = GpuBackend::new(gpu, SoftOptions::default()).unwrap();
    for case in CASES {
        let (options, rates) = drawing(case);
        let (cpu, cpu_stats, cpu_seen) = step(&mut CpuBackend::new(options), case, &rates);
        backend = backend.with_options(options);
        let (gpu, gpu_stats, gpu_seen) = step(&mut backend, case, &rates);
        eprintln!("{}: {cpu_stats:?}\n    {gpu_stats:?}", case.name);
        for (a, b) in groups(&cpu.first).into_iter().zip(groups(&gpu.first)) {
            eprintln!("    {} {:.1e}", a.0, apart(&a.1, &b.1));
        }
        let (a, b) = (&cpu_seen.first, &gpu_seen.first);
        eprintln!("    weight {:.1e} radius {:.1e}", apart(&a.max_weight, &b.max_weight), apart(&a.max_radius_px, &b.max_radius_px));
        let views = a.views.iter().zip(&b.views).filter(|(a, b)| a != b).count();
        let error = |errors: &[u64]| errors.iter().map(|&e| e as f32).collect::<Vec<f32>>();
        eprintln!("    views {views} error {:.1e}", apart(&error(&cpu_seen.error), &error(&gpu_seen.error)));
    }
}
