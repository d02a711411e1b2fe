//! Whole runs on the synthetic scene: as good as the CPU's, the same bits twice, resumed bit for
//! bit, from one backend to the other and back.

use super::{card, small_card};
use std::borrow::Cow;
use std::ops::ControlFlow::{self, Continue};
use std::path::Path;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_raster::soft::{Frame, SoftOptions};
use trisplat_scene::{Error, Result, Soup, camera::Camera};
use trisplat_synthetic::SyntheticOptions;
use trisplat_train::{
    BackendVisibility, Checkpoint, CpuBackend, GpuBackend, GpuLimits, OptimizerState, Params,
    SampleWeight, StepParams, StepPhoto, StepStats, TrainBackend, TrainEvent, TrainInputs,
    TrainObserver, TrainOptions, TrainOutputs, TrainPreset, Trained, checkpoint,
};

fn dataset(folder: &Path) -> Dataset {
    let options =
        SyntheticOptions { views: 12, width: 48, points: 200, ..SyntheticOptions::default() };
    trisplat_synthetic::write(folder, &options).unwrap();
    Dataset::load(folder, &DatasetOptions::default()).unwrap()
}

/// Corners move less than by default: roundings grow with every step, and large triangles would
/// make the widest.
fn options(preset: TrainPreset, steps: u64) -> TrainOptions {
    let mut options = TrainOptions { steps, max_triangles: 800, ..TrainOptions::preset(preset) };
    options.rates.corners = 0.02;
    options
}

/// Stops after a number of steps.
fn stop_after(steps: u64) -> impl FnMut(TrainEvent<'_>) -> ControlFlow<()> {
    let mut left = steps;
    move |event| {
        left -= u64::from(matches!(event, TrainEvent::Step { .. }));
        if left == 0 { ControlFlow::Break(()) } else { Continue(()) }
    }
}

/// A card that several runs use, one after another.
#[derive(Debug)]
struct Lent<'a>(&'a mut GpuBackend);

impl TrainBackend for Lent<'_> {
    fn load(&mut self, state: OptimizerState) -> Result<()> {
        self.0.load(state)
    }

    fn step(&mut self, photo: &StepPhoto<'_>, rates: &StepParams) -> Result<()> {
        self.0.step(photo, rates)
    }

    fn figures(&mut self, all: bool) -> Result<Vec<StepStats>> {
        self.0.figures(all)
    }

    fn take_visibility(&mut self) -> Result<BackendVisibility> {
        self.0.take_visibility()
    }

    fn store(&mut self) -> Result<OptimizerState> {
        self.0.store()
    }

    fn params(&mut self) -> Result<Cow<'_, Params>> {
        self.0.params()
    }

    fn can_be_lost(&self) -> bool {
        self.0.can_be_lost()
    }

    fn rescued(&mut self) -> Option<OptimizerState> {
        self.0.rescued()
    }

    fn draws(&self) -> bool {
        self.0.draws()
    }

    fn picture(
        &mut self,
        camera: &Camera,
        drawing: &SoftOptions,
        rates: &StepParams,
    ) -> Result<Frame> {
        self.0.picture(camera, drawing, rates)
    }

    fn len(&self) -> usize {
        self.0.len()
    }
}

/// Runs `run` on the CPU, or on the card of `backend`.
fn trained(
    run: TrainInputs<'_>,
    backend: Option<&mut GpuBackend>,
    observer: TrainObserver<'_>,
) -> Trained {
    let drawing = run.drawing();
    let backend: Box<dyn TrainBackend + '_> = match backend {
        Some(backend) => {
            let limits = GpuLimits::of(backend.gpu());
            backend.restart(drawing, limits);
            Box::new(Lent(backend))
        }
        None => Box::new(CpuBackend::new(drawing)),
    };
    run.start_with(backend).unwrap().finish(observer).unwrap()
}

fn psnr(trained: &Trained) -> f64 {
    trained.scores.iter().map(|s| s.psnr).sum::<f64>() / trained.scores.len() as f64
}

/// A card that is ready for runs.
fn backend() -> Option<GpuBackend> {
    let card = card()?;
    let limits = GpuLimits::of(&card);
    Some(GpuBackend::new(card, SoftOptions::default(), limits).unwrap())
}

/// The difference that 99% of the corners' coordinates stay below, in units of the scene's size.
fn corners_apart(a: &Soup, b: &Soup) -> f32 {
    let numbers = |soup: &Soup| {
        soup.vertices.iter().flatten().flat_map(|v| v.to_array()).collect::<Vec<f32>>()
    };
    let a = numbers(a);
    let b = numbers(b);
    let size = a.iter().fold(0.0f32, |most, x| most.max(x.abs()));
    let mut apart: Vec<f32> = a.iter().zip(&b).map(|(a, b)| (a - b).abs() / size).collect();
    apart.sort_by(f32::total_cmp);
    apart[apart.len() * 99 / 100]
}

#[test]
fn soft_runs_are_those_of_the_cpu() {
    let Some(mut card) = backend() else { return };
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    for (preset, densified, sample_by) in [
        (TrainPreset::Outdoor, true, SampleWeight::Alternating),
        (TrainPreset::Outdoor, true, SampleWeight::Error),
        (TrainPreset::Indoor, false, SampleWeight::Alternating),
    ] {
        let mut options = options(preset, 100);
        options.densify.sample_by = sample_by;
        if !densified {
            options.densify.every = 1e9;
        }
        let run = || TrainInputs::new(&dataset, &options);
        let gpu = trained(run(), Some(&mut card), &mut |_| Continue(()));
        let cpu = trained(run(), None, &mut |_| Continue(()));
        let psnr = (psnr(&gpu) - psnr(&cpu)).abs();
        let apart = corners_apart(&cpu.soup, &gpu.soup);
        eprintln!(
            "{preset:?}, densified {densified} by {sample_by:?}: {psnr:.4} dB, corners {apart:.1e}, {} triangles",
            gpu.soup.len()
        );
        assert!(psnr < 0.05 && gpu.dropped == 0, "{preset:?}: {psnr} dB");
        // Another triangle pruned, and nothing is at its place any more.
        assert!(densified || apart < 1e-4, "{preset:?}: {apart}");
    }
}

/// Turning solid amplifies every rounding, as opacities are driven to 0 or 1 and the faint are
/// pruned: compared are runs from the same checkpoint in the part that is drawn as an engine draws.
#[test]
fn a_solid_run_is_that_of_the_cpu_from_where_it_is_opaque() {
    let Some(mut card) = backend() else { return };
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let path = folder.path().join("a.checkpoint");
    let outputs = TrainOutputs { checkpoint: Some(path.clone()), ..TrainOutputs::default() };
    let first =
        TrainInputs { outputs, ..TrainInputs::new(&dataset, &options(TrainPreset::Solid, 200)) };
    trained(first, None, &mut stop_after(150));
    let rest = || TrainInputs::from_checkpoint(&dataset, checkpoint::read(&path).unwrap());
    let gpu = trained(rest(), Some(&mut card), &mut stop_after(20));
    let cpu = trained(rest(), None, &mut stop_after(20));
    let psnr = (psnr(&gpu) - psnr(&cpu)).abs();
    let apart = corners_apart(&cpu.soup, &gpu.soup);
    eprintln!("solid: {psnr:.4} dB, corners {apart:.1e}, {} triangles", gpu.soup.len());
    assert_eq!((gpu.steps, gpu.soup.len(), gpu.dropped), (170, cpu.soup.len(), 0));
    assert!(psnr < 0.05 && apart < 1e-4);
}

#[test]
fn the_same_bits_twice_and_after_a_stop() {
    let Some(mut card) = backend() else { return };
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let options = options(TrainPreset::Solid, 90);
    let run = |resume: Option<Checkpoint>, outputs: &TrainOutputs| TrainInputs {
        resume,
        outputs: outputs.clone(),
        ..TrainInputs::new(&dataset, &options)
    };
    let straight =
        trained(run(None, &TrainOutputs::default()), Some(&mut card), &mut |_| Continue(()));
    let path = folder.path().join("a.checkpoint");
    let outputs = TrainOutputs { checkpoint: Some(path.clone()), ..TrainOutputs::default() };
    // Before and after it is drawn as an engine draws.
    for stop in [31, 64] {
        trained(run(None, &outputs), Some(&mut card), &mut stop_after(stop));
        let rest = run(Some(checkpoint::read(&path).unwrap()), &outputs);
        let resumed = trained(rest, Some(&mut card), &mut |_| Continue(()));
        assert_eq!(resumed.soup, straight.soup, "stopped after {stop}");
        assert_eq!(resumed.scores, straight.scores);
    }
}

#[test]
fn a_checkpoint_goes_from_one_backend_to_the_other_and_back() {
    let Some(mut card) = backend() else { return };
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let options = options(TrainPreset::Outdoor, 90);
    let path = folder.path().join("a.checkpoint");
    let outputs = TrainOutputs { checkpoint: Some(path.clone()), ..TrainOutputs::default() };
    let mut resume = None;
    let mut parts = Vec::new();
    for on_card in [true, false, true] {
        let run = TrainInputs {
            resume,
            outputs: outputs.clone(),
            ..TrainInputs::new(&dataset, &options)
        };
        let backend = on_card.then_some(&mut card);
        parts.push(trained(run, backend, &mut stop_after(30)));
        resume = Some(checkpoint::read(&path).unwrap());
    }
    let whole = trained(TrainInputs::new(&dataset, &options), None, &mut |_| Continue(()));
    assert_eq!(parts[2].steps, 90);
    assert!((psnr(&parts[2]) - psnr(&whole)).abs() < 0.05);
    assert!(corners_apart(&whole.soup, &parts[2].soup) < 1e-4);
}

#[test]
fn gpu_lost_costs_the_steps_since_the_last_refinement() {
    let Some(mut card) = backend() else { return };
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let options = options(TrainPreset::Outdoor, 100);
    let straight =
        trained(TrainInputs::new(&dataset, &options), Some(&mut card), &mut |_| Continue(()));
    let path = folder.path().join("a.checkpoint");
    let outputs = TrainOutputs { checkpoint: Some(path.clone()), ..TrainOutputs::default() };
    let run = TrainInputs { outputs, ..TrainInputs::new(&dataset, &options) };
    // Takes the card away, and notes when the scene was densified.
    let device = card.gpu().device.clone();
    let mut densified = 0;
    let mut observer = |event: TrainEvent<'_>| {
        match event {
            TrainEvent::Step { sample, .. } if sample.step == 70 => device.destroy(),
            TrainEvent::Densified(step, _) => densified = step,
            _ => {}
        }
        Continue(())
    };
    card.restart(run.drawing(), GpuLimits::of(card.gpu()));
    let error =
        run.start_with(Box::new(Lent(&mut card))).unwrap().finish(&mut observer).unwrap_err();
    eprintln!("{error}");
    assert!(
        matches!(error, Error::Card { .. }) && error.to_string().contains("card was lost"),
        "{error}"
    );
    let remedy =
        format!("to continue from step {densified}: `backend` cpu `resume` {}", path.display());
    assert!(densified > 0 && error.to_string().ends_with(&remedy), "{error}");
    let rest = || TrainInputs::from_checkpoint(&dataset, checkpoint::read(&path).unwrap());
    // Another card gives what the first would have given, and the CPU something as good.
    let again = trained(rest(), Some(&mut backend().unwrap()), &mut |_| Continue(()));
    assert_eq!(again.soup, straight.soup);
    assert!((psnr(&trained(rest(), None, &mut |_| Continue(()))) - psnr(&straight)).abs() < 0.05);
}

#[test]
fn a_card_that_is_too_small_costs_no_step() {
    // The layers of pixels are in one binding.
    let Some(small) = small_card(128 << 10) else { return };
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let mut options = options(TrainPreset::Outdoor, 100);
    options.draw.sort_per_pixel = true;
    let path = folder.path().join("a.checkpoint");
    let outputs = TrainOutputs { checkpoint: Some(path.clone()), ..TrainOutputs::default() };
    let run = TrainInputs { outputs, ..TrainInputs::new(&dataset, &options) };
    let limits = GpuLimits::of(&small);
    let mut card = GpuBackend::new(small, run.drawing(), limits).unwrap();
    let error = run
        .start_with(Box::new(Lent(&mut card)))
        .unwrap()
        .finish(&mut |_| Continue(()))
        .unwrap_err()
        .to_string();
    eprintln!("{error}");
    assert!(
        error.contains("gpu: layers for ") && error.contains("`backend` cpu `resume` "),
        "{error}"
    );
    let rest = TrainInputs::from_checkpoint(&dataset, checkpoint::read(&path).unwrap());
    assert_eq!(trained(rest, None, &mut |_| Continue(())).steps, 100);
}
