//! Photos become a GLB: train a solid scene, bake it with the photos at hand.
//!
//! `cargo run --release --example train_and_bake [PHOTOS] [OUT.glb] [STEPS]`; without arguments a short run on the sample
//! photos.

#![allow(clippy::print_stdout, reason = "a program talks to its user")]

use std::path::Path;
use trisplat::{BakeJob, BakeOptions, Dataset, DatasetOptions, Result, TrainJob, TrainOptions, TrainPreset};
use trisplat_job::{BakeInput, TrainJobObserver};
use trisplat_train::{TrainObserver, TrainSample};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |i: usize, default: &str| arguments.get(i).cloned().unwrap_or_else(|| default.to_owned());
    let photos = argument(0, concat!(env!("CARGO_MANIFEST_DIR"), "/samples/dataset"));
    let out = argument(1, "photos.glb");
    let steps = argument(2, "300").parse().expect("STEPS is a number");

    let dataset = Dataset::load(Path::new(&photos), &DatasetOptions::default())?;
    let options = TrainOptions { steps, max_triangles: 4000, ..TrainOptions::preset(TrainPreset::Solid) };
    let trained = TrainJob::new(dataset.clone(), options).run(&mut PrintProgress)?.trained;

    let mut bake = BakeJob::new([BakeInput::scene(trained)], BakeOptions::default());
    bake.photos = Some(dataset);
    let done = bake.save(Path::new(&out), &mut ())?;
    for file in done.report.outputs {
        println!("{}: {} triangles, {} bytes", file.path, done.asset.mesh.face_count(), file.bytes);
    }
    Ok(())
}

/// Prints a line whenever a sample of the curve is taken.
struct PrintProgress;

impl TrainJobObserver for PrintProgress {}

impl TrainObserver for PrintProgress {
    fn sampled(&mut self, sample: &TrainSample) {
        println!(
            "step {:>5}: {:.2} dB on the photos, {} triangles",
            sample.step, sample.psnr, sample.triangles
        );
    }
}
