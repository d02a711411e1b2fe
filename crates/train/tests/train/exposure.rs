//! The exposures of photos, found while a scene is trained, against what was done to them.

use super::train;
use std::ops::ControlFlow::Continue;
use std::path::Path;
use trisplat_dataset::exposure::{ExposureUse, Strengths};
use trisplat_dataset::{Dataset, DatasetOptions};
use trisplat_fixtures::phone::{TENTH_OF_A_STOP, error_of_gains, phone_sample, true_spread};
use trisplat_train::{TrainInputs, TrainOptions, TrainOutputs, TrainPreset, checkpoint};

fn options(steps: u64) -> TrainOptions {
    let solid = TrainOptions::preset(TrainPreset::Solid);
    TrainOptions { steps, max_triangles: 3000, exposure: ExposureUse::On, ..solid }
}

fn load(folder: &Path) -> Dataset {
    Dataset::load(folder, &DatasetOptions { max_size: Some(96), ..DatasetOptions::default() })
        .unwrap()
}

#[test]
fn exposure_of_a_phone_is_found_also_by_a_resumed_run() {
    let folder = tempfile::tempdir().unwrap();
    let truth = phone_sample(folder.path());
    let dataset = load(folder.path());
    let path = folder.path().join("a.checkpoint");
    let outputs = TrainOutputs {
        checkpoint: Some(path.clone()),
        checkpoint_every: 300,
        ..TrainOutputs::default()
    };
    let all = options(600);
    let half = TrainInputs { outputs, until_step: Some(300), ..TrainInputs::new(&dataset, &all) };
    half.run(&mut |_| Continue(())).unwrap();
    let trained = TrainInputs::from_checkpoint(&dataset, checkpoint::read(&path).unwrap())
        .run(&mut |_| Continue(()))
        .unwrap();
    let details = trained.exposure.clone().expect("photos were asked");
    assert_eq!(details.verdict.unwrap().strengths, Strengths::FULL);
    let names: Vec<&str> = dataset.train().map(|view| view.name.as_str()).collect();
    let error = error_of_gains(&truth, &names, &details.exposures.gains);
    assert!(error < 0.02, "gains are off by {error}");
    let spread = f64::from(details.verdict.unwrap().exposure);
    assert!((spread - true_spread(&truth, &names)).abs() < TENTH_OF_A_STOP, "{spread}");
    let whole = train(&dataset, &all).unwrap();
    assert!(whole.soup == trained.soup && whole.exposure == trained.exposure);
}

#[test]
fn photos_are_taken_as_they_are_unless_something_decided() {
    let dataset = load(&trisplat_fixtures::sample("dataset"));
    let undecided = TrainOptions { exposure: ExposureUse::Auto, ..options(20) };
    let trained = train(&dataset, &undecided).unwrap();
    assert!(trained.exposure.is_none() && trained.provenance.exposure.is_none());
    let half = TrainOptions { exposure: ExposureUse::Shares([0.5, 0.0, 0.0]), ..undecided };
    let trained = train(&dataset, &half).unwrap();
    assert_eq!(trained.provenance.exposure, Some([0.5, 0.0, 0.0]), "the bake follows it");
    let spread = trained.exposure.unwrap().verdict.unwrap().exposure;
    assert!(spread < 0.02, "these photos agree: {spread}");
}
