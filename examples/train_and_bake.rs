//! Photos become a GLB: train a solid scene, bake it with the photos at hand, measure the file on held-out photos.
//!
//! `cargo run --release --example train_and_bake [PHOTOS] [OUT.glb] [STEPS]`; without arguments a short run on the sample
//! photos.

use std::path::Path;
use trisplat::train::{TrainObserver, TrainSample};
use trisplat::{
    Bake, BakeOptions, Dataset, DatasetOptions, OutputOptions, Report, Result, TrainOptions, TrainPreset,
    TrainRun, Views, write,
};

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |i: usize, default: &str| arguments.get(i).cloned().unwrap_or_else(|| default.to_owned());
    let photos = argument(0, concat!(env!("CARGO_MANIFEST_DIR"), "/samples/dataset"));
    let out = argument(1, "photos.glb");
    let steps = argument(2, "300").parse().expect("STEPS is a number");

    let dataset_options = DatasetOptions::default();
    let dataset = Dataset::load(Path::new(&photos), &dataset_options)?;
    let options = TrainOptions { steps, max_triangles: 4000, ..TrainOptions::preset(TrainPreset::Solid) };
    let trained = TrainRun::new(&dataset, &options).run(&mut PrintProgress)?;

    let mut views = Views::new(&dataset, &dataset_options);
    let mut report = Report::new("train_and_bake");
    let asset = Bake::new(&BakeOptions::default()).photos(&mut views).report(&mut report).run([trained])?;
    let written = write(&asset, Path::new(&out), &OutputOptions::default())?;
    for file in written.files {
        println!("{}: {} triangles, {} bytes", file.path, asset.mesh.face_count(), file.bytes);
    }
    Ok(())
}

/// Prints a line whenever a sample of the curve is taken.
struct PrintProgress;

impl TrainObserver for PrintProgress {
    fn sampled(&mut self, sample: &TrainSample) {
        println!(
            "step {:>5}: {:.2} dB on the photos, {} triangles",
            sample.step, sample.psnr, sample.triangles
        );
    }
}
