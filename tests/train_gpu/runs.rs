//! Whole runs on the synthetic scene: as good as the CPU's, the same bits twice, resumed bit for bit, from one backend to the
//! other and back.

use super::card;
use std::path::Path;
use trisplat::dataset::synthetic::{self, SyntheticOptions};
use trisplat::dataset::{Dataset, DatasetOptions};
use trisplat::train::cpu::CpuBackend;
use trisplat::train::gpu::GpuBackend;
use trisplat::train::{
    Checkpoint, RunOptions, TrainBackend, TrainObserver, TrainOptions, TrainPreset, TrainRun, Trained, checkpoint,
};

fn dataset(folder: &Path) -> Dataset {
    let options = SyntheticOptions { views: 12, width: 48, points: 200, ..SyntheticOptions::default() };
    synthetic::write(folder, &options).unwrap();
    Dataset::load(folder, &DatasetOptions::default()).unwrap()
}

fn options(preset: TrainPreset, steps: u64) -> TrainOptions {
    TrainOptions { steps, max_triangles: 800, ..TrainOptions::preset(preset) }
}

/// Stops after a number of steps.
struct StopAfter(u64);

impl TrainObserver for StopAfter {
    fn wants_to_stop(&mut self) -> bool {
        self.0 -= 1;
        self.0 == 0
    }
}

/// Runs `run`, on the card or on the CPU; `None` without a card.
fn trained(run: TrainRun<'_>, on_card: bool, observer: &mut dyn TrainObserver) -> Option<Trained> {
    let backend: Box<dyn TrainBackend> = match on_card {
        true => Box::new(GpuBackend::new(card()?, run.drawing()).unwrap()),
        false => Box::new(CpuBackend::new(run.drawing())),
    };
    Some(run.start_on(backend).unwrap().finish(observer).unwrap())
}

fn psnr(trained: &Trained) -> f64 {
    trained.scores.iter().map(|s| s.psnr).sum::<f64>() / trained.scores.len() as f64
}

#[test]
fn a_run_comes_as_close_to_the_photos_as_the_cpus() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    for preset in [TrainPreset::Outdoor, TrainPreset::Indoor, TrainPreset::Solid] {
        let run = || TrainRun::new(&dataset, &options(preset, 200));
        let Some(gpu) = trained(run(), true, &mut ()) else { return };
        let cpu = trained(run(), false, &mut ()).unwrap();
        eprintln!(
            "{preset:?}: {:.3} dB of {} triangles, on the CPU {:.3} dB of {}",
            psnr(&gpu),
            gpu.soup.len(),
            psnr(&cpu),
            cpu.soup.len()
        );
        assert!((psnr(&gpu) - psnr(&cpu)).abs() < 0.05);
        assert_eq!(gpu.dropped, 0);
    }
}

#[test]
fn the_same_bits_twice_and_after_a_stop() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let options = options(TrainPreset::Solid, 90);
    let run = |resume: Option<Checkpoint>, outputs: &RunOptions| TrainRun {
        resume,
        outputs: outputs.clone(),
        ..TrainRun::new(&dataset, &options)
    };
    let Some(straight) = trained(run(None, &RunOptions::default()), true, &mut ()) else { return };
    let path = folder.path().join("a.checkpoint");
    let outputs = RunOptions { checkpoint: Some(path.clone()), ..RunOptions::default() };
    for stop in [31, 64] {
        trained(run(None, &outputs), true, &mut StopAfter(stop)).unwrap();
        let resumed = trained(run(Some(checkpoint::read(&path).unwrap()), &outputs), true, &mut ()).unwrap();
        assert_eq!(resumed.soup, straight.soup, "stopped after {stop}");
        assert_eq!(resumed.scores, straight.scores);
    }
}

#[test]
fn a_checkpoint_goes_from_one_backend_to_the_other_and_back() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = dataset(folder.path());
    let options = options(TrainPreset::Outdoor, 90);
    let path = folder.path().join("a.checkpoint");
    let outputs = RunOptions { checkpoint: Some(path.clone()), ..RunOptions::default() };
    let mut resume = None;
    for (on_card, stop) in [(true, 30), (false, 30), (true, 30)] {
        let run = TrainRun { resume, outputs: outputs.clone(), ..TrainRun::new(&dataset, &options) };
        let Some(part) = trained(run, on_card, &mut StopAfter(stop)) else { return };
        if part.steps == 90 {
            let whole = trained(TrainRun::new(&dataset, &options), false, &mut ()).unwrap();
            assert!((psnr(&part) - psnr(&whole)).abs() < 0.05, "{} {}", psnr(&part), psnr(&whole));
        }
        resume = Some(checkpoint::read(&path)).transpose().unwrap();
    }
}
