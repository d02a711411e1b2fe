//! The exposures of photos, found while a scene is trained, against what was done to them.

use super::train;
use crate::common::phone::{TENTH_OF_A_STOP, error_of_gains, phone_sample, true_spread};
use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_train::{RunOptions, TrainOptions, TrainPreset, TrainRun, checkpoint};

fn options(steps: u64) -> TrainOptions {
    TrainOptions { steps, max_triangles: 3000, ..TrainOptions::preset(TrainPreset::Solid) }
}

fn load(folder: &Path) -> Dataset {
    Dataset::load(folder, &DatasetOptions { max_size: Some(96), ..DatasetOptions::default() }).unwrap()
}

#[test]
fn what_a_phone_did_is_found_again_and_a_run_that_goes_on_finds_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let truth = phone_sample(folder.path());
    let dataset = load(folder.path());
    let path = folder.path().join("a.checkpoint");
    let outputs =
        RunOptions { checkpoint: Some(path.clone()), checkpoint_every: 300, ..RunOptions::default() };
    let all = options(600);
    let half = TrainRun { outputs, until_step: Some(300), ..TrainRun::new(&dataset, &all) };
    half.run(&mut |_| Continue(())).unwrap();
    let trained = TrainRun::from_checkpoint(&dataset, checkpoint::read(&path).unwrap())
        .run(&mut |_| Continue(()))
        .unwrap();
    let details = trained.exposure.clone().expect("photos were asked");
    assert_eq!(details.verdict.unwrap().strength, 1.0, "{:?}", details.verdict);
    let names: Vec<&str> = dataset.train().map(|view| view.name.as_str()).collect();
    let error = error_of_gains(&truth, &names, &details.exposures.gains);
    assert!(error < 0.02, "gains are off by {error}");
    let spread = f64::from(details.verdict.unwrap().exposure);
    assert!((spread - true_spread(&truth, &names)).abs() < TENTH_OF_A_STOP, "{spread}");
    let whole = train(&dataset, &all).unwrap();
    assert!(whole.soup == trained.soup && whole.exposure == trained.exposure);
}

#[test]
fn photos_that_agree_are_left_as_they_are() {
    let dataset = load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("samples/dataset"));
    let details = train(&dataset, &options(200)).unwrap().exposure.expect("photos were asked");
    assert!(
        details.exposures.gains.is_empty() && details.verdict.unwrap().strength == 0.0,
        "{:?}",
        details.verdict
    );
}
